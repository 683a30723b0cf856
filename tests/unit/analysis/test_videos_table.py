"""The table of everyday videos: its distances, the facing of a person, and a missing folder."""

import numpy as np

from analysis.tables.__main__ import main
from analysis.tables.videos import Measured, distances, facing, heights_m, read_limb_joints
from workbench.body.skeleton import JOINT_NAMES

LEFT, RIGHT = (JOINT_NAMES.index(f"{side}_shoulder") for side in ("left", "right"))
LEFT_HIP, RIGHT_HIP = (JOINT_NAMES.index(f"{side}_hip") for side in ("left", "right"))


def shoulders(left_u, right_u):
    pixels = np.full((1, len(JOINT_NAMES), 2), np.nan)
    pixels[0, LEFT], pixels[0, RIGHT] = (left_u, 50.0), (right_u, 50.0)
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
    assert row == ["1", "4.5", "1.5", "3.00", "33", "1 of 2", "90", "doubtful", "2.3"]


def test_facing_is_that_of_the_shoulders_where_they_show_it():
    height = 100.0  # three standard deviations of a difference are 4.24 px
    assert facing(shoulders(60.0, 40.0), shoulders(55.0, 45.0), height) == [True]
    assert facing(shoulders(40.0, 60.0), shoulders(55.0, 45.0), height) == [False]
    assert facing(shoulders(60.0, 40.0), shoulders(52.2, 48.0), height) == []
    assert facing(shoulders(60.0, 40.0), shoulders(52.3, 48.0), height) == [True]
    contradicted = shoulders(55.0, 45.0)
    contradicted[0, LEFT_HIP], contradicted[0, RIGHT_HIP] = (45.0, 90.0), (55.0, 90.0)
    assert facing(shoulders(60.0, 40.0), contradicted, height) == []
    assert facing(shoulders(np.nan, np.nan), shoulders(55.0, 45.0), height) == [False]


def test_heights_and_annotations_are_read(tmp_path):
    (tmp_path / "README.md").write_text(
        "| file | what |\n| --- | --- |\n| a.mp4 | walks; about 1.80 m | x |\n| b.avi | |\n"
    )
    assert heights_m(tmp_path / "README.md") == {"a.mp4": 1.8}
    assert heights_m(tmp_path / "none.md") == {}
    (tmp_path / "a.csv").write_text("frame,joint,u,v,visible\n7,left_toe,1,2,1\n7,left_knee,3,4,1\n2,left_hip,5,6,0\n")
    frames, pixels, visible = read_limb_joints(tmp_path / "a.csv")
    assert frames == [2, 7]
    knee = JOINT_NAMES.index("left_knee")
    assert pixels[1, knee].tolist() == visible[1, knee].tolist() == [3.0, 4.0]
    assert pixels[0, LEFT_HIP].tolist() == [5.0, 6.0]
    assert np.isfinite(visible).sum() == 2


def test_the_class_has_a_dash_without_facing():
    row = Measured(np.full((1, 1), np.nan), np.full((1, 1), np.nan), [], 1.0, "trustworthy", 1.0).cells()
    assert row[1:6] == ["–", "–", "–", "–", "–"]
