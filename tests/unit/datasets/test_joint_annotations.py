"""The reader of marks: what is written comes back; what is wrong is named with its file and line."""

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from workbench.body.skeleton import JOINT_NAMES
from workbench.datasets.files.joint_annotations import COLUMNS, read_annotations
from workbench.utils.errors import InputError

HEADER = "frame,joint,u,v,visible\n"
pixel = st.floats(-5000.0, 5000.0, allow_nan=False)
marks = st.dictionaries(
    st.tuples(st.integers(0, 10**6), st.sampled_from(JOINT_NAMES)), st.tuples(pixel, pixel, st.booleans()), min_size=1
)


@pytest.fixture
def file(tmp_path):
    return tmp_path / "marks.csv"


def outcome(file, text):
    file.write_bytes(text if isinstance(text, bytes) else text.encode())
    with pytest.raises(InputError) as caught:
        read_annotations(file)
    return str(caught.value)


@settings(suppress_health_check=[HealthCheck.function_scoped_fixture], deadline=None)
@given(marks=marks, columns=st.permutations(COLUMNS), blank=st.booleans(), bom=st.booleans())
def test_every_mark_comes_back_whatever_the_order(file, marks, columns, blank, bom):
    rows = [
        {"frame": f, "joint": j, "u": repr(u), "v": repr(v), "visible": int(visible)}
        for (f, j), (u, v, visible) in marks.items()
    ]
    lines = [",".join(columns), *(",".join(str(row[c]) for c in columns) for row in rows)]
    file.write_text(("\n\n" if blank else "\r\n").join(lines), encoding="utf-8-sig" if bom else "utf-8", newline="")
    read = read_annotations(file)
    assert list(read.frames) == sorted({f for f, _ in marks})
    assert np.isfinite(read.pixels[..., 0]).sum() == len(marks)
    assert not read.visible[np.isnan(read.pixels[..., 0])].any()
    for (frame, joint), (u, v, visible) in marks.items():
        pixels, seen = read.at(frame)
        assert tuple(pixels[JOINT_NAMES.index(joint)]) == (u, v)
        assert seen[JOINT_NAMES.index(joint)] == visible
    assert read.at(10**6 + 1) is None


@settings(suppress_health_check=[HealthCheck.function_scoped_fixture], deadline=None)
@given(st.one_of(st.binary(max_size=200), st.text(max_size=200).map(lambda t: (HEADER + t).encode())))
def test_any_bytes_are_read_or_refused(file, text):
    file.write_bytes(text)
    message = ""
    try:
        read = read_annotations(file)
        assert len(read.frames) > 0
    except InputError as error:
        message = str(error)
    assert message == "" or str(file) in message


@pytest.mark.parametrize(
    ("text", "line", "words"),
    [
        ("", 1, "columns"),
        ("frame,joint,u,v\n1,neck,1,2\n", 1, "visible"),
        (HEADER + "1,neck,1,2,1\n\n2,nose,1,2,1\n", 4, "nose"),
        (HEADER + "1,neck,1,2\n", 2, "5 cells, found 4"),
        (HEADER + "1,neck,abc,2,1\n", 2, "u must be a number of pixels, found 'abc'"),
        (HEADER + "٣,neck,1,2,1\n", 2, "a frame number"),
        (HEADER + "1,neck,1,2,yes\n", 2, "0 or 1"),
        (HEADER + "1,neck,1,2,1\n2,neck,1,2,1\n1,neck,3,4,1\n", 4, "already annotated in line 2"),
    ],
)
def test_a_wrong_row_is_named_with_its_line(file, text, line, words):
    message = outcome(file, text)
    assert message.startswith(f"{file}:{line}: ")
    assert words in message


def test_a_file_without_marks_or_without_text_or_no_file_at_all(file, tmp_path):
    assert "at least one annotation" in outcome(file, HEADER)
    assert "text file" in outcome(file, b"\xff\xfe\x00")
    with pytest.raises(InputError, match="no such file"):
        read_annotations(tmp_path / "none.csv")
    with pytest.raises(InputError, match="expected a folder of OpenPose's JSON files, found none"):
        read_annotations(tmp_path / "..")
