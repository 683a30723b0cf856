"""Rows of numbers in text: the fast reader and that of single lines give the same numbers and refuse the same."""

import numpy as np
import pytest

from workbench.motion.formats.text import number_rows, read_lines
from workbench.utils import input_limits
from workbench.utils.errors import InputError


def unread(k):
    raise ValueError(f"line {k}")


@pytest.mark.parametrize(
    ("delimiter", "texts", "expected"),
    [
        (None, ["1 2.5  -3e2", "\t4 5 6 "], [[1, 2.5, -300], [4, 5, 6]]),
        ("\t", ["1\t2,5\t3", "4\t\tNaN"], [[1, 2.5, 3], [4, np.nan, np.nan]]),
        (",", ["1,,3", "4, 5,"], [[1, np.nan, 3], [4, 5, np.nan]]),
    ],
)
def test_many_lines_are_read_at_once(delimiter, texts, expected):
    values = number_rows(list(enumerate(texts)), 3, delimiter, unread)
    np.testing.assert_array_equal(values, expected)


@pytest.mark.parametrize("text", ["0.1 2.2250738585072014e-308 0.30000000000000004", "5e-324 123456789.123456789 1e11"])
def test_numbers_are_those_of_python(text):
    values = number_rows([(1, text)], 3, None, unread)
    assert values[0].tolist() == list(map(float, text.split()))


@pytest.mark.parametrize(
    ("delimiter", "text"),
    [
        (None, "1 2"), (None, "1 2 3 4"), (None, "1 2 3 4 5"), (None, "1 2 inf"), (None, "1 2 1e12"), (None, "1 2 1_0"),
        (None, "1 2 x"), (None, ""), (None, "1 2" + 300 * " " + "3"), (",", "1,2"), (",", "1,2,3,4"),
        (",", "1,2,3,4,5"),
        (",", '1,2,"3"'), (",", "1,null,2"), ("\t", "1 2 3"),
    ],
)  # fmt: skip
def test_other_lines_are_read_singly(delimiter, text):
    with pytest.raises(ValueError, match="line 1"):
        number_rows([(1, "1 2 3" if delimiter is None else "1,2,3".replace(",", delimiter)), (2, text)], 3, delimiter,
                    lambda k: [1.0, 2.0, 3.0] if k == 0 else unread(k))  # fmt: skip


@pytest.mark.parametrize("may_end", [False, True])
def test_last_cells_may_be_absent(may_end):
    values = number_rows([(1, "1\t2\t3"), (2, "4\t5")], 3, "\t", lambda k: [9.0, 9.0, 9.0], may_end)
    np.testing.assert_array_equal(values, [[1, 2, 3], [4, 5, np.nan]] if may_end else np.full((2, 3), 9.0))


def test_the_number_of_lines_is_bounded(tmp_path, monkeypatch):
    monkeypatch.setattr(input_limits, "MAX_LINES", 3)
    (tmp_path / "a.txt").write_text("a\n\n\n")
    assert read_lines(tmp_path / "a.txt") == ["a", "", ""]
    (tmp_path / "a.txt").write_text("a\n\n\n\n")
    with pytest.raises(InputError, match=r"a\.txt"):
        read_lines(tmp_path / "a.txt")
