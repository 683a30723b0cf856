"""OpenPose's files: which points are which joints, who is followed, what is refused."""

import json
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from openpose_scenes import points, standing, write

from workbench.body.skeleton import JOINT_NAMES
from workbench.datasets.files.joint_annotations import read_annotations
from workbench.motion.formats.keypoint_layouts import LAYOUTS
from workbench.motion.formats.openpose import read_openpose
from workbench.utils.errors import InputError


@pytest.mark.parametrize("layout", LAYOUTS)
def test_every_layout_is_told_by_its_points(tmp_path, layout):
    joints = standing(300.0, 100.0)
    found = read_openpose(write(tmp_path, {7: [points(layout, joints)], 12: [points(layout, joints)]}))
    assert (found.layout, found.frames.tolist()) == (layout, [7, 12])
    known = set(LAYOUTS[layout][1]) & set(joints)
    assert len(known) >= 12
    for name, place in joints.items():
        expected = [*place, 0.8] if name in known else [np.nan] * 3
        np.testing.assert_allclose(found.joints[0][0, JOINT_NAMES.index(name)], expected)


def test_the_published_numbers_of_points():
    # OpenPose's documentation (BODY_25, COCO) and its training repository (BODY_25B)
    assert LAYOUTS["BODY_25"][1]["left_ankle"] == (14,)
    assert LAYOUTS["BODY_25"][1]["right_shoulder"] == (2,)
    assert LAYOUTS["BODY_25B"][1]["right_ankle"] == (16,)
    assert LAYOUTS["COCO_18"][1]["left_hip"] == (11,)


PLACES = st.floats(2.0, 2000.0, allow_nan=False)
PERSON = st.one_of(
    st.just("empty"), st.just("zeros"),
    st.lists(st.one_of(st.none(), st.tuples(PLACES, PLACES, st.floats(0.01, 1.0))), min_size=17, max_size=17),
)  # fmt: skip


@settings(max_examples=40)
@given(st.lists(st.lists(PERSON, max_size=4), min_size=1, max_size=5))
def test_whatever_is_written_is_read(frames):
    def rows(one):
        if isinstance(one, str):
            return np.zeros((17 if one == "zeros" else 0, 3))
        return np.array([point or (0.0, 0.0, 0.0) for point in one])

    with TemporaryDirectory() as folder:
        write(Path(folder), {3 * t: [rows(one) for one in people] for t, people in enumerate(frames)})
        anybody = any(rows(one).any() for people in frames for one in people)
        if not anybody:
            assert f"found none in {len(frames)}" in refusal(folder)
            return
        found = read_openpose(folder)
    assert found.layout == "COCO_17"
    assert found.frames.tolist() == [3 * t for t in range(len(frames))]
    assert [len(one) for one in found.joints] == [len(people) for people in frames]
    numbers = LAYOUTS["COCO_17"][1]
    for joints, people in zip(found.joints, frames, strict=True):
        for one, person in zip(joints, people, strict=True):
            there = rows(person) if len(rows(person)) else np.zeros((17, 3))
            for name in ("left_wrist", "right_knee"):
                (number,) = numbers[name]
                expected = there[number] if there[number, 2] > 0.0 else [np.nan] * 3
                np.testing.assert_allclose(one[JOINT_NAMES.index(name)], expected)


def test_a_folder_can_stand_where_a_file_of_marks_does(tmp_path):
    joints = standing(300.0, 100.0)
    marks = read_annotations(write(tmp_path, {3: [points("COCO_17", joints, 0.4)], 5: []}))
    weighted = marks.weighted(3, 0.35)
    np.testing.assert_allclose(weighted[JOINT_NAMES.index("left_knee")], [*joints["left_knee"], 0.4])
    assert np.isnan(weighted[JOINT_NAMES.index("pelvis")]).all()
    assert marks.visible[0].sum() == 13
    assert np.isnan(marks.weighted(5, 0.35)).all()
    assert marks.weighted(4, 0.35) is None


def refusal(folder):
    with pytest.raises(InputError) as caught:
        read_openpose(folder)
    return str(caught.value)


def test_what_is_no_such_folder_is_refused(tmp_path):
    assert "expected a folder of OpenPose's JSON files" in refusal(tmp_path)
    joints = standing(300.0, 100.0)
    good = write(tmp_path / "good", {0: [points("COCO_17", joints)]})
    (good / "shot_1.json").write_text(json.dumps({"people": [{"pose_keypoints_2d": [1.0] * 30}]}))
    assert "expected one of 25 (BODY_25)" in refusal(good)
    (good / "shot_1.json").write_text(json.dumps({"people": [{"pose_keypoints_2d": [1.0] * 54}]}))
    assert "the same number of points per person in every file, found [17, 18]" in refusal(good)
    assert "found none in 2" in refusal(write(tmp_path / "empty", {0: [], 1: []}))
    assert "already in" in refusal(write(write(tmp_path / "twice", {1: []}), {1: []}, "other_{}.json"))
    assert "frame's number" in refusal(write(tmp_path / "none", {1: []}, "keypoints.json"))
    assert "coordinates in pixels" in refusal(write(tmp_path / "relative", {1: [points("COCO_17", joints) * 1e-3]}))
