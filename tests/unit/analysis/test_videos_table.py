"""The table of everyday videos: its distances, the facing of a person, and a missing folder."""

import numpy as np
import pytest
from recording_steps import BODY, CAMERA, SPACE, steps

from analysis.tables.__main__ import main
from analysis.tables.videos import (
    _UPRIGHT_OVER_HEIGHT,
    Measured,
    Subject,
    detected_joints,
    distances,
    facing,
    heights_m,
    projected_joints,
    subjects,
)
from workbench.body.kinematics import joints
from workbench.body.shape import from_height
from workbench.body.skeleton import JOINT_NAMES, person_skeleton
from workbench.recording.read.reader import read
from workbench.recording.write.recorder import Recorder

LEFT, RIGHT = (JOINT_NAMES.index(f"{side}_shoulder") for side in ("left", "right"))
LEFT_HIP, RIGHT_HIP = (JOINT_NAMES.index(f"{side}_hip") for side in ("left", "right"))


def pairs(shoulders=(np.nan, np.nan), hips=(np.nan, np.nan)):
    """Return joints (1, J, 2) of which left and right shoulders and hips are at these u."""
    pixels = np.full((1, len(JOINT_NAMES), 2), np.nan)
    for joint, u in zip((LEFT, RIGHT, LEFT_HIP, RIGHT_HIP), (*shoulders, *hips), strict=True):
        pixels[0, joint] = u, 50.0
    return pixels


def test_a_missing_folder_is_a_reason_and_not_a_traceback(tmp_path, capsys):
    assert main(["videos", "--videos", str(tmp_path / "none"), "-o", str(tmp_path)]) == 1
    assert f"not made: videos: expected a folder of annotated videos, --videos FOLDER, found {tmp_path / 'none'}" in (
        capsys.readouterr().err
    )
    assert main(["videos", "--videos", str(tmp_path), "-o", str(tmp_path)]) == 1
    assert "expected videos NAME.mp4 with annotations NAME.csv, found none" in capsys.readouterr().err
    assert not list(tmp_path.iterdir())


def test_joints_without_an_estimate_are_far_and_joints_without_annotation_do_not_count():
    annotated, estimated = np.zeros((1, 3, 2)), np.array([[[3.0, 4.0], [np.nan, np.nan], [1.0, 0.0]]])
    annotated[0, 2] = np.nan
    np.testing.assert_array_equal(distances(estimated, annotated), [[5.0, np.inf, np.nan]])
    errors, detected = np.array([[0.02, np.inf, np.nan, 0.07]]), np.array([[0.01, 0.01, np.nan, 0.02]])
    row = Measured(errors, detected, [True, False], 0.9, "doubtful", 2.345).cells()
    assert row == ["1", "1.5", "4.5", "7.0", "33", "1 of 2", "90", "doubtful", "2.3"]


@pytest.mark.parametrize(("distance", "close"), [(0.0599, "100"), (0.0601, "0")])
def test_joints_are_close_up_to_six_percent(distance, close):
    errors = np.array([[distance]])
    assert Measured(errors, errors, [], 1.0, "trustworthy", 1.0).cells()[4] == close


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


def test_heights_are_read(tmp_path):
    (tmp_path / "README.md").write_text(
        "| file | what |\n| --- | --- |\n| a.mp4 | walks; about 1.80 m | x |\n| b.avi | |\n"
    )
    assert heights_m(tmp_path / "README.md") == {"a.mp4": 1.8}
    assert heights_m(tmp_path / "none.md") == {}


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


def test_unknown_numbers_are_dashes():
    row = Measured(np.full((1, 1), np.nan), np.full((1, 1), np.nan), [], 1.0, "trustworthy", 1.0).cells()
    assert row[1:6] == ["–", "–", "–", "–", "–"]


def test_joints_are_read_from_the_recording_in_pixels_of_the_video(tmp_path):
    path, poses = tmp_path / "run.rrd", []
    with Recorder(path, BODY, SPACE, run_id="run", config_yaml="", provenance={}) as recorder:
        for step in steps(3, n_particles=20):
            recorder.log(step, {})
            poses.append(step.expected_pose)
    pixels = projected_joints(read(path), [10, 12, 17])
    expected = [CAMERA.project(joints(BODY.skeleton, poses[k][None])[0]) for k in (0, 2)]
    np.testing.assert_allclose(pixels[:2], expected, atol=0.01)
    assert np.isnan(pixels[2]).all()
    assert np.isnan(detected_joints(read(path), [10, 12])).all()
