"""The table of everyday videos: its distances, the facing of a person, and a missing folder."""

import numpy as np
import pytest
from recorded import record
from recording_steps import BODY, CAMERA, steps

from analysis.tables.videos import (
    _UPRIGHT_OVER_HEIGHT,
    Measured,
    Subject,
    detected_joints,
    distances,
    facing,
    projected_joints,
    subjects,
)
from workbench.body.kinematics import joints
from workbench.body.shape import from_height
from workbench.body.skeleton import JOINT_NAMES, person_skeleton
from workbench.recording.read.reader import read

LEFT, RIGHT = (JOINT_NAMES.index(f"{side}_shoulder") for side in ("left", "right"))
LEFT_HIP, RIGHT_HIP = (JOINT_NAMES.index(f"{side}_hip") for side in ("left", "right"))


def pairs(shoulders=(np.nan, np.nan), hips=(np.nan, np.nan)):
    """Return joints (1, J, 2) of which left and right shoulders and hips are at these u."""
    pixels = np.full((1, len(JOINT_NAMES), 2), np.nan)
    for joint, u in zip((LEFT, RIGHT, LEFT_HIP, RIGHT_HIP), (*shoulders, *hips), strict=True):
        pixels[0, joint] = u, 50.0
    return pixels


def test_joints_without_an_estimate_are_far_and_joints_without_annotation_do_not_count():
    annotated, estimated = np.zeros((1, 3, 2)), np.array([[[3.0, 4.0], [np.nan, np.nan], [1.0, 0.0]]])
    annotated[0, 2] = np.nan
    np.testing.assert_array_equal(distances(estimated, annotated), [[5.0, np.inf, np.nan]])
    errors, detected = np.array([[0.02, np.inf, np.nan, 0.07]]), np.array([[0.01, 0.01, np.nan, 0.02]])
    row = Measured(errors, detected, [True, False], 0.9, "doubtful", 2.345).cells()
    assert row == ["1", "1.5", "4.5", "7.0", "33", "1 of 2", "90", "doubtful", "2.3"]


def test_facing_is_that_of_shoulders_and_hips_where_they_show_it():
    height = 100.0  # three standard deviations of a difference are 4.24 px of shoulders and 8.49 px of hips
    assert facing(pairs((60.0, 40.0)), pairs((55.0, 45.0)), height) == [True]
    assert facing(pairs((40.0, 60.0)), pairs((55.0, 45.0)), height) == [False]
    assert facing(pairs((60.0, 40.0)), pairs((52.2, 48.0)), height) == []
    assert facing(pairs((60.0, 40.0)), pairs((52.3, 48.0)), height) == [True]
    assert facing(pairs((60.0, 40.0), (60.0, 40.0)), pairs((50.0, 50.0), (48.4, 40.0)), height) == []
    assert facing(pairs((60.0, 40.0), (60.0, 40.0)), pairs((50.0, 50.0), (48.6, 40.0)), height) == [True]
    assert facing(pairs((60.0, 40.0), (40.0, 60.0)), pairs((55.0, 45.0), (55.0, 45.0)), height) == [False]
    assert facing(pairs(), pairs((55.0, 45.0)), height) == [False]


def test_subjects_are_the_annotated_videos_and_the_woman_if_she_is_there(tmp_path):
    videos, data = tmp_path / "videos", tmp_path / "data"
    for name in ("videos/a.mp4", "videos/a.csv", "videos/b.avi", "data/sports2d_walk/demo.mp4"):
        (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / name).touch()
    (videos / "README.md").write_text("| a.mp4 | about 1.80 m |")
    a = Subject(videos / "a.mp4", videos / "a.csv", 1.8)
    assert subjects(videos, None) == subjects(videos, tmp_path) == [a]
    walk = data / "sports2d_walk"
    assert subjects(videos, data) == [a, Subject(walk / "demo.mp4", walk / "keypoints.csv", 1.65)]


def test_the_height_is_that_of_an_average_person_upright():
    person = joints(person_skeleton(from_height(1.0)), np.zeros((1, 25)))[0]
    length = person[JOINT_NAMES.index("head_centre")] - person[JOINT_NAMES.index("left_ankle")]
    assert length[2] == pytest.approx(_UPRIGHT_OVER_HEIGHT, abs=0.0005)


def test_joints_are_read_from_the_recording_in_pixels_of_the_video(tmp_path):
    run = list(steps(3, n_particles=20))
    path = record(tmp_path / "run.rrd", run)
    pixels = projected_joints(read(path), [10, 12, 17])
    expected = [CAMERA.project(joints(BODY.skeleton, run[k].expected_pose[None])[0]) for k in (0, 2)]
    np.testing.assert_allclose(pixels[:2], expected, atol=0.01)
    assert np.isnan(pixels[2]).all()
    assert np.isnan(detected_joints(read(path), [10, 12])).all()
