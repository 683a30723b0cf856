"""The reader of annotations: values are read back, and an error names the file and the line."""

import json

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from openpose_scenes import points, standing, write

from workbench.body.skeleton import JOINT_NAMES
from workbench.detections.joint_annotations import COLUMNS, read_annotations
from workbench.utils.errors import InputError

HEADER = "frame,joint,u,v,visible\n"
pixel = st.floats(-5000.0, 5000.0, allow_nan=False)
annotated_joints = st.dictionaries(
    st.tuples(st.integers(0, 10**6), st.sampled_from(JOINT_NAMES)),
    st.tuples(pixel, pixel, st.booleans()),
    min_size=1,
    max_size=10,
)


@pytest.fixture
def path(tmp_path):
    return tmp_path / "annotations.csv"


def error_message(path, text):
    path.write_bytes(text if isinstance(text, bytes) else text.encode())
    with pytest.raises(InputError) as error:
        read_annotations(path)
    return str(error.value)


@settings(suppress_health_check=[HealthCheck.function_scoped_fixture], deadline=None, max_examples=60)
@given(annotations=annotated_joints, columns=st.permutations(COLUMNS), blank_lines=st.booleans(), bom=st.booleans())
def test_annotations_are_read_in_any_order_of_columns(path, annotations, columns, blank_lines, bom):
    rows = [
        {"frame": f, "joint": j, "u": repr(u), "v": repr(v), "visible": int(visible)}
        for (f, j), (u, v, visible) in annotations.items()
    ]
    lines = [",".join(columns), *(",".join(str(row[c]) for c in columns) for row in rows)]
    path.write_text(
        ("\n\n" if blank_lines else "\r\n").join(lines), encoding="utf-8-sig" if bom else "utf-8", newline=""
    )
    read = read_annotations(path)
    assert list(read.frames) == sorted({f for f, _ in annotations})
    assert np.isfinite(read.pixels[..., 0]).sum() == len(annotations)
    assert not read.visible[np.isnan(read.pixels[..., 0])].any()
    for (frame, joint), (u, v, visible) in annotations.items():
        pixels, visibility = read.at(frame)
        assert tuple(pixels[JOINT_NAMES.index(joint)]) == (u, v)
        assert visibility[JOINT_NAMES.index(joint)] == visible
    assert read.at(10**6 + 1) is None


@pytest.mark.parametrize(
    ("text", "line", "words"),
    [
        ("", 1, "columns"),
        ("frame,joint,u,v\n1,neck,1,2\n", 1, "visible"),
        (HEADER + "1,neck,1,2,1\n\n2,left_horn,1,2,1\n", 4, "unknown joint 'left_horn'"),
        (HEADER + "1,neck,1,2,1\n2,-,1,2,1\n", 3, "unknown joint '-'"),
        (HEADER + "1,left_toe,a,2,1\n", 2, "u must be a number"),
        (HEADER + "1,neck,1,2\n", 2, "5 cells, found 4"),
        (HEADER + "1,neck,abc,2,1\n", 2, "u must be a number of pixels, found 'abc'"),
        (HEADER + "٣,neck,1,2,1\n", 2, "a frame number"),
        (HEADER + "1,neck,1,2,yes\n", 2, "0 or 1"),
        (HEADER + "1,neck,1,2,1\n2,neck,1,2,1\n1,neck,3,4,1\n", 4, "already annotated in line 2"),
    ],
)
def test_the_error_of_an_invalid_row_names_its_line(path, text, line, words):
    message = error_message(path, text)
    assert message.startswith(f"{path}:{line}: ")
    assert words in message


def test_points_that_the_body_does_not_have_are_omitted_and_named_once(path, caplog):
    path.write_text(
        HEADER + "1,left_toe,1,2,1\n1,left_knee,3,4,1\n2,left_toe,5,6,1\n2,left_heel,7,8,0\n3,left_knee,9,9,1\n"
    )
    read = read_annotations(path)
    assert read.frames.tolist() == [1, 3]
    assert read.pixels[np.isfinite(read.pixels)].tolist() == [3.0, 4.0, 9.0, 9.0]
    assert read.other_points == ("left_heel", "left_toe")
    assert caplog.messages == [f"{path}: not used, because the body has no such joints: left_heel, left_toe"]
    assert "at least one annotation" in error_message(path, HEADER + "1,left_toe,1,2,1\n")


def test_files_without_annotations_are_an_error(path, tmp_path):
    assert "at least one annotation" in error_message(path, HEADER)
    assert "text file" in error_message(path, b"\xff\xfe\x00")
    with pytest.raises(InputError, match="no such file"):
        read_annotations(tmp_path / "none.csv")
    with pytest.raises(InputError, match=r"expected a folder of a detector's JSON files .*found none"):
        read_annotations(tmp_path / "..")


def with_world_landmarks(folder, world):
    """Write files of one BlazePose person with world landmarks (T, 33, 3)."""
    folder.mkdir()
    pixels = points("BLAZEPOSE_33", standing(100.0, 50.0))
    for t, landmarks in enumerate(world):
        person = {"pose_keypoints_2d": pixels.ravel().tolist(), "world_landmarks": landmarks.ravel().tolist()}
        (folder / f"shot_{t:03d}.json").write_text(json.dumps({"people": [person]}))
    return folder


def test_world_landmarks_are_converted_to_joints(tmp_path):
    world = np.random.default_rng(0).standard_normal((6, 33, 3))
    world[:, [11, 12, 23, 24], 0] += [9.0, -9.0, 9.0, -9.0]  # shoulders and hips have left and right on the same sides
    annotations = read_annotations(with_world_landmarks(tmp_path / "shots", world))
    landmarks = annotations.world_landmarks_at(4)
    np.testing.assert_allclose(landmarks[JOINT_NAMES.index("left_knee")], world[4, 25])
    np.testing.assert_allclose(landmarks[JOINT_NAMES.index("head_centre")], world[4, 7:9].mean(axis=0))
    assert np.isnan(landmarks[JOINT_NAMES.index("pelvis")]).all()
    assert annotations.world_landmarks_at(99) is None
    selection = annotations.select(annotations.frames == 4)
    np.testing.assert_array_equal(selection.world_landmarks_at(4), landmarks)


@pytest.mark.parametrize("world", [np.zeros((2, 32, 3)), np.full((2, 33, 3), np.nan)])
def test_invalid_world_landmarks_are_an_error(tmp_path, world):
    with pytest.raises(InputError, match="world_landmarks"):
        read_annotations(with_world_landmarks(tmp_path / "shots", world))


def test_files_without_world_landmarks_have_none(tmp_path):
    pixels = points("BLAZEPOSE_33", standing(100.0, 50.0))
    annotations = read_annotations(write(tmp_path / "shots", {t: [pixels] for t in range(4)}))
    assert annotations.world_landmarks is None
    assert annotations.world_landmarks_at(2) is None
