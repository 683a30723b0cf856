"""OpenPose's files: which points are which joints, who is followed, what is refused."""

import json

import numpy as np
import pytest
from openpose_scenes import points, standing, write

from workbench.body.skeleton import JOINT_NAMES
from workbench.datasets.files.marks import read_marks
from workbench.errors import InputError
from workbench.mocap.openpose import LAYOUTS, read_openpose


@pytest.mark.parametrize("layout", LAYOUTS)
def test_every_layout_is_told_by_its_points(tmp_path, layout):
    joints = standing(300.0, 100.0)
    found = read_openpose(write(tmp_path, {7: [points(layout, joints)], 12: [points(layout, joints)]}))
    assert (found.layout, found.frames.tolist()) == (layout, [7, 12])
    known = set(LAYOUTS[layout][1]) & set(joints)
    assert len(known) >= 13
    for name, place in joints.items():
        expected = [*place, 0.8] if name in known else [np.nan] * 3
        np.testing.assert_allclose(found.joints[0, JOINT_NAMES.index(name)], expected)


def test_the_published_numbers_of_points():
    # OpenPose's documentation (BODY_25, COCO) and its training repository (BODY_25B)
    assert LAYOUTS["BODY_25"][1]["left_ankle"] == (14,)
    assert LAYOUTS["BODY_25"][1]["right_shoulder"] == (2,)
    assert LAYOUTS["BODY_25B"][1]["right_ankle"] == (16,)
    assert LAYOUTS["COCO_18"][1]["left_hip"] == (11,)


def test_zeros_are_joints_that_were_not_found(tmp_path):
    joints = standing(300.0, 100.0)
    del joints["left_wrist"]
    found = read_openpose(write(tmp_path, {0: [points("BODY_25", joints)]}))
    assert np.isnan(found.joints[0, JOINT_NAMES.index("left_wrist")]).all()
    assert np.isnan(found.joints[0, JOINT_NAMES.index("neck")]).all()  # the middle of the shoulders is not our neck


def test_who_is_followed_does_not_depend_on_the_order(tmp_path):
    def person(u, t, size, confidence=0.8):
        return points("COCO_17", standing(u + 10.0 * t, 100.0, size), confidence)

    frames = {}
    for t in range(6):
        near, far, doubtful = person(500, t, 200), person(100, t, 80), person(900, t, 220, 0.1)
        frames[t] = [[near, far, doubtful], [far, doubtful, near], [doubtful, near, far]][t % 3]
    frames[3] = frames[3][1:]  # without the one who is followed: nobody else is taken for them
    folder = write(tmp_path, frames)
    heads = read_openpose(folder).joints[:, JOINT_NAMES.index("head_centre"), 0]
    np.testing.assert_allclose(heads, [500, 510, 520, np.nan, 540, 550])
    heads = read_openpose(folder, person=1).joints[:, JOINT_NAMES.index("head_centre"), 0]
    np.testing.assert_allclose(heads, 100 + 10.0 * np.arange(6))


def test_a_folder_can_stand_where_a_file_of_marks_does(tmp_path):
    joints = standing(300.0, 100.0)
    marks = read_marks(write(tmp_path, {3: [points("COCO_17", joints, 0.4)], 5: []}))
    weighted = marks.weighted(3, 0.35)
    np.testing.assert_allclose(weighted[JOINT_NAMES.index("left_knee")], [*joints["left_knee"], 0.4])
    assert np.isnan(weighted[JOINT_NAMES.index("pelvis")]).all()
    assert marks.visible[0].sum() == 13
    assert np.isnan(marks.weighted(5, 0.35)).all()
    assert marks.weighted(4, 0.35) is None


def refusal(folder, **given):
    with pytest.raises(InputError) as caught:
        read_openpose(folder, **given)
    return str(caught.value)


def test_what_is_no_such_folder_is_refused(tmp_path):
    assert "expected a folder of OpenPose's JSON files" in refusal(tmp_path)
    joints = standing(300.0, 100.0)
    good = write(tmp_path / "good", {0: [points("COCO_17", joints)]})
    assert "no person 1" in refusal(good, person=1)
    (good / "shot_1.json").write_text("{")
    assert "shot_1.json" in refusal(good)
    (good / "shot_1.json").write_text(json.dumps({"people": [{"pose_keypoints_2d": [1.0] * 30}]}))
    assert "expected one of 25 (BODY_25)" in refusal(good)
    (good / "shot_1.json").write_text(json.dumps({"people": [{"pose_keypoints_2d": [float("nan")] * 51}]}))
    assert "not finite" in refusal(good)
    (good / "shot_1.json").write_text(json.dumps({"people": [{"pose_keypoints_2d": [1.0] * 54}]}))
    assert "as many points a person in every file, found [17, 18]" in refusal(good)
    assert "found nobody in 2" in refusal(write(tmp_path / "empty", {0: [], 1: []}))
    assert "already in" in refusal(write(write(tmp_path / "twice", {1: []}), {1: []}, "other_{}.json"))
    assert "frame's number" in refusal(write(tmp_path / "none", {1: []}, "keypoints.json"))
