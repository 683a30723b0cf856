"""Numbers and tables as text, and labels that do not overlap."""

import numpy as np
import pytest

from workbench.recording.study.drawing import spread
from workbench.results.formatting import number


@pytest.mark.parametrize(
    ("value", "expected"),
    [
        (0.0, "0"), (5e-17, "0"), (28.697, "28.70"), (0.26182, "0.2618"), (-12.34567, "-12.35"), (999.96, "1000"),
        (1000.0, "1000"), (11000.4, "11000"), (1.0, "1.000"), (np.nan, "–"), (np.inf, "–"), (1.234e-7, "1.234e-07"),
    ],
)  # fmt: skip
def test_four_digits_are_shown(value, expected):
    assert number(value) == expected


def test_labels_move_only_where_they_would_overlap():
    assert spread([0.0, 20.0, 100.0], 13.0).tolist() == [0.0, 20.0, 100.0]
    # three within a gap are centred on their mean, the fourth stays
    np.testing.assert_allclose(spread([10.0, 11.0, 12.0, 90.0], 13.0), [-2.0, 11.0, 24.0, 90.0])
    assert spread([], 13.0).tolist() == []
