"""Layouts of points, people per frame in folders of JSON files, and invalid folders."""

import json
import re
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from openpose_scenes import people_in, points, standing, write

from workbench.body.skeleton import FOOT_POINTS, JOINT_NAMES
from workbench.detections.joint_annotations import read_annotations
from workbench.detections.readers.formats import LAYOUTS
from workbench.detections.readers.named_points import foot_points, joints_of_points, layout_joints, named_points
from workbench.utils.errors import InputError


@pytest.mark.parametrize("layout", LAYOUTS)
def test_every_layout_is_recognized_by_its_points(tmp_path, layout):
    joints = standing(300.0, 100.0)
    detections = people_in(write(tmp_path, {7: [points(layout, joints)], 12: [points(layout, joints)]}))
    assert (detections.layout, detections.frames.tolist()) == (layout, [7, 12])
    known = set(layout_joints(LAYOUTS[layout])) & set(joints)
    assert len(known) >= 12
    for name, pixel in joints.items():
        expected = [*pixel, 0.8] if name in known else [np.nan] * 3
        np.testing.assert_allclose(detections.joints[0][0, JOINT_NAMES.index(name), :3], expected)


PUBLISHED = {
    "BODY_25": (7, 10, 14, (17, 18)), "BODY_25B": (9, 14, 15, (17, 18)), "BODY_135": (9, 14, 15, (17, 18)),
    "HALPE_26": (9, 14, 15, (17, 18)), "HALPE_136": (9, 14, 15, (17, 18)), "COCO_18": (7, 9, 13, (16, 17)),
    "COCO_17": (9, 14, 15, (3, 4)), "COCO_133": (9, 14, 15, (3, 4)), "MPII_16": (15, 1, 5, (8, 9)),
    "MPI_15": (7, 9, 13, None), "BLAZEPOSE_33": (15, 26, 27, (7, 8)),
}  # fmt: skip
"""Numbers of the left wrist, the right knee, the left ankle and the head's points, in the documentation of OpenPose
(BODY_25, COCO, MPI) and its training repository (BODY_25B, BODY_135), Halpe-FullBody, COCO, COCO-WholeBody, MPII and
MediaPipe."""


@pytest.mark.parametrize("layout", LAYOUTS)
def test_points_have_their_published_numbers(layout):
    numbers, (wrist, knee, ankle, head) = layout_joints(LAYOUTS[layout]), PUBLISHED[layout]
    assert len(LAYOUTS[layout]) == int(re.sub(r"\D", "", layout.partition("_")[2]))
    assert (numbers["left_wrist"], numbers["right_knee"], numbers["left_ankle"]) == ((wrist,), (knee,), (ankle,))
    assert numbers.get("head_centre") == head


FEET = {
    "BODY_25": ((21,), (19, 20), (24,), (22, 23)), "BODY_25B": ((21,), (19, 20), (24,), (22, 23)),
    "BODY_135": ((21,), (19, 20), (24,), (22, 23)), "HALPE_26": ((24,), (20, 22), (25,), (21, 23)),
    "HALPE_136": ((24,), (20, 22), (25,), (21, 23)), "COCO_133": ((19,), (17, 18), (22,), (20, 21)),
    "BLAZEPOSE_33": ((29,), (31,), (30,), (32,)),
}  # fmt: skip
"""Numbers of the points of left heel, left toes, right heel and right toes, in the same documentation."""


@pytest.mark.parametrize("layout", LAYOUTS)
def test_feet_have_their_published_numbers(layout):
    numbers = layout_joints(LAYOUTS[layout])
    found = {name: numbers[name] for name in FOOT_POINTS if name in numbers}
    assert found == dict(zip(FOOT_POINTS, FEET.get(layout, ()), strict=False))


def test_feet_follow_their_ankles():
    """Heel and toes are at the mean of their points with the smallest confidence, in the row of their ankle."""
    layout = LAYOUTS["BODY_25"]
    person = np.random.default_rng(0).uniform(0.1, 1.0, (25, 3))
    joints = joints_of_points(layout_joints(layout), person)
    assert joints.shape == (15, 12)
    np.testing.assert_array_equal(joints[:, :3], joints_of_points(layout_joints(layout[:19]), person))
    feet = foot_points(joints)
    np.testing.assert_array_equal(feet[0], person[21])
    np.testing.assert_allclose(feet[1], [*person[19:21, :2].mean(axis=0), person[19:21, 2].min()])
    np.testing.assert_array_equal(feet[2], person[24])
    assert np.isnan(
        np.delete(joints[:, 3:], [JOINT_NAMES.index(f"{side}_ankle") for side in ("left", "right")], axis=0)
    ).all()
    assert foot_points(joints[:, :6]) is None


@pytest.mark.parametrize(
    ("names", "toes"),
    [
        (("LHeel", "LBigToe", "LSmallToe"), (2, 3)),
        (("heel_left", "toe_left"), (2,)),
        (("left_heel", "left_foot_index"), (2,)),
    ],
)
def test_named_points_may_be_feet(names, toes):
    numbers = named_points(("left_knee", *names))
    assert numbers == {"left_knee": (0,), "left_heel": (1,), "left_toes": toes}
    assert named_points(names) == {}


PIXELS = st.floats(2.0, 2000.0, allow_nan=False)
PERSON = st.one_of(
    st.just("empty"), st.just("zeros"),
    st.lists(st.one_of(st.none(), st.tuples(PIXELS, PIXELS, st.floats(0.01, 1.0))), min_size=17, max_size=17),
)  # fmt: skip


@settings(max_examples=25)
@given(st.lists(st.lists(PERSON, max_size=4), min_size=1, max_size=5))
def test_written_people_are_read_back(frames):
    def rows(person):
        if isinstance(person, str):
            return np.zeros((17 if person == "zeros" else 0, 3))
        return np.array([point or (0.0, 0.0, 0.0) for point in person])

    with TemporaryDirectory() as folder:
        write(Path(folder), {3 * t: [rows(person) for person in people] for t, people in enumerate(frames)})
        if not any(rows(person).any() for people in frames for person in people):
            assert f"found none in {len(frames)}" in error_message(folder)
            return
        detections = people_in(folder)
    assert detections.layout == "COCO_17"
    assert detections.frames.tolist() == [3 * t for t in range(len(frames))]
    assert [len(joints) for joints in detections.joints] == [len(people) for people in frames]
    numbers = layout_joints(LAYOUTS["COCO_17"])
    for joints, people in zip(detections.joints, frames, strict=True):
        for pixels, person in zip(joints, people, strict=True):
            written = rows(person) if len(rows(person)) else np.zeros((17, 3))
            for name in ("left_wrist", "right_knee"):
                (number,) = numbers[name]
                expected = written[number] if written[number, 2] > 0.0 else [np.nan] * 3
                np.testing.assert_allclose(pixels[JOINT_NAMES.index(name)], expected)


def test_a_folder_can_replace_a_file_of_annotations(tmp_path):
    joints = standing(300.0, 100.0)
    annotations = read_annotations(write(tmp_path, {3: [points("COCO_17", joints, 0.4)], 5: []}))
    weighted = annotations.weighted(3, 0.35)
    np.testing.assert_allclose(weighted[JOINT_NAMES.index("left_knee")], [*joints["left_knee"], 0.4])
    assert np.isnan(weighted[JOINT_NAMES.index("pelvis")]).all()
    assert annotations.visible[0].sum() == 13
    assert np.isnan(annotations.weighted(5, 0.35)).all()
    assert annotations.weighted(4, 0.35) is None


def error_message(folder):
    with pytest.raises(InputError) as error:
        people_in(folder)
    return str(error.value)


def test_invalid_folders_are_rejected(tmp_path):
    assert "expected a folder of a detector's JSON files" in error_message(tmp_path)
    joints = standing(300.0, 100.0)
    good = write(tmp_path / "good", {0: [points("COCO_17", joints)]})
    (good / "shot_1.json").write_text(json.dumps({"people": [{"pose_keypoints_2d": [1.0] * 33}]}))
    assert "expected one of 25 (BODY_25)" in error_message(good)
    (good / "shot_1.json").write_text(json.dumps({"people": [{"pose_keypoints_2d": [1.0] * 54}]}))
    assert "the same number of points per person in every file, found [17, 18]" in error_message(good)
    assert "found none in 2" in error_message(write(tmp_path / "empty", {0: [], 1: []}))
    assert "already in" in error_message(write(write(tmp_path / "twice", {1: []}), {1: []}, "other_{}.json"))
    assert "frame's number" in error_message(write(tmp_path / "none", {1: []}, "keypoints.json"))
    assert "coordinates in pixels" in error_message(
        write(tmp_path / "relative", {1: [points("COCO_17", joints) * 1e-3]})
    )
