"""The reader of marks: what is written comes back; what is wrong is named with its file and line."""

import json

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from openpose_scenes import points, standing, write

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


def with_world_landmarks(folder, world):
    """Files of one BlazePose person, frame by frame, with the world landmarks of `world` (T, 33, 3)."""
    folder.mkdir()
    pixels = points("BLAZEPOSE_33", standing(100.0, 50.0))
    for t, landmarks in enumerate(world):
        person = {"pose_keypoints_2d": pixels.ravel().tolist(), "world_landmarks": landmarks.ravel().tolist()}
        (folder / f"shot_{t:03d}.json").write_text(json.dumps({"people": [person]}))
    return folder


def test_world_landmarks_of_the_target_are_those_of_its_joints(tmp_path):
    world = np.random.default_rng(0).standard_normal((6, 33, 3))
    annotations = read_annotations(with_world_landmarks(tmp_path / "shots", world))
    found = annotations.world_landmarks_at(4)
    np.testing.assert_allclose(found[JOINT_NAMES.index("left_knee")], world[4, 25])
    np.testing.assert_allclose(found[JOINT_NAMES.index("head_centre")], world[4, 7:9].mean(axis=0))
    assert np.isnan(found[JOINT_NAMES.index("pelvis")]).all()
    assert annotations.world_landmarks_at(99) is None
    part = annotations.select(annotations.frames == 4)
    np.testing.assert_array_equal(part.world_landmarks_at(4), found)


@pytest.mark.parametrize("world", [np.zeros((2, 32, 3)), np.full((2, 33, 3), np.nan)])
def test_world_landmarks_of_another_number_or_not_finite_are_an_error(tmp_path, world):
    with pytest.raises(InputError, match="world_landmarks"):
        read_annotations(with_world_landmarks(tmp_path / "shots", world))


def test_files_without_world_landmarks_have_none(tmp_path):
    pixels = points("BLAZEPOSE_33", standing(100.0, 50.0))
    annotations = read_annotations(write(tmp_path / "shots", {t: [pixels] for t in range(4)}))
    assert annotations.world_landmarks is None
    assert annotations.world_landmarks_at(2) is None
