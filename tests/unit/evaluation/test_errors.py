"""Errors and posterior summaries against numbers worked out by hand."""

from dataclasses import replace

import numpy as np
import pytest
from single_steps import BODY, CAMERA, SKELETON, standing, step_of

from workbench.body.kinematics import joints
from workbench.core.frame import Truth
from workbench.evaluation.pose_errors import moved_joints, step_errors


def test_a_shift_of_the_root_is_an_absolute_error_only():
    pose = standing()
    moved = pose + np.eye(25)[0] * 0.03
    truth = Truth(pose=pose, joints=joints(SKELETON, pose[None])[0])
    errors = step_errors(step_of(moved[None], truth), BODY)
    assert errors["error_abs_mm"] == pytest.approx(30)
    assert errors["error_rel_mm"] == pytest.approx(0, abs=1e-9)
    # 700 px focal length, 7 m away (limbs a little nearer or farther): 30 mm are about 3 px
    assert errors["error_px"] == pytest.approx(3.0, abs=0.15)
    assert step_errors(step_of(moved[None], truth), BODY, image_scale=0.5)["error_px"] == pytest.approx(
        2 * errors["error_px"]
    )


def test_pixels_are_those_of_the_camera_that_took_the_image():
    """An estimate that a camera told wrong shows on the person costs no pixels, and one at the true place does."""
    pose, beside = standing(), replace(CAMERA, translation=CAMERA.translation + np.array([0.1, 0.0, 0.0]))
    truth = Truth(pose=pose, joints=joints(SKELETON, pose[None])[0], cameras=(beside,))
    at_truth = step_errors(step_of(pose[None], truth), BODY)
    assert at_truth["error_abs_mm"] == pytest.approx(0.0)
    for name in ("error_px", "humaneva_px"):
        assert at_truth[name] == pytest.approx(10.0, rel=0.05)  # 10 cm in 7 m at 700 px
    told = replace(step_of(pose[None], truth).frame, truth=Truth(joints=truth.joints, cameras=(CAMERA,)))
    errors = step_errors(replace(step_of(pose[None], truth), frame=told), BODY)
    assert errors["error_px"] == pytest.approx(0.0, abs=1e-9)


def test_a_bent_elbow_moves_one_joint_of_fourteen():
    pose = standing()
    bent = pose.copy()
    bent[SKELETON.dof("left_elbow_flexion")] = np.pi / 3
    truth = Truth(joints=joints(SKELETON, pose[None])[0])
    errors = step_errors(step_of(bent[None], truth), BODY)
    forearm = 0.146 * 1800
    assert errors["error_rel_mm"] == pytest.approx(forearm / 14)  # 60° moves the wrist by one forearm
    assert "coverage_90" not in errors


def test_marks_count_where_visible():
    pose = standing()
    marks = CAMERA.project(joints(SKELETON, pose[None])[0])
    visible = np.ones(15, dtype=bool)
    marks[3] += [30.0, 40.0]
    marks[4:] = np.nan
    marks[0] = np.nan
    errors = step_errors(step_of(pose[None], Truth(marks=marks, marks_visible=visible)), BODY)
    assert errors["error_px"] == pytest.approx(50 / 3)
    visible[3] = False
    errors = step_errors(step_of(pose[None], Truth(marks=marks, marks_visible=visible)), BODY)
    assert errors["error_px"] == pytest.approx(0, abs=1e-9)
    assert "error_abs_mm" not in errors


def test_errors_are_over_the_joints_that_can_move():
    arm = ["left_shoulder_twist", "left_elbow_flexion"]
    names = [SKELETON.names[joint] for joint in moved_joints(SKELETON, arm)]
    assert names == ["left_elbow", "left_wrist"]  # those below the joints that turn; they themselves stay
    assert [SKELETON.names[joint] for joint in moved_joints(SKELETON, ["left_elbow_flexion"])] == ["left_wrist"]
    assert len(moved_joints(SKELETON, ["root_z"])) == len(moved_joints(SKELETON, ["root_roll"])) == 14
    pose = standing()
    bent = pose.copy()
    bent[SKELETON.dof("left_elbow_flexion")] = np.pi / 3
    truth = Truth(joints=joints(SKELETON, pose[None])[0])
    forearm = 0.146 * 1800
    assert step_errors(step_of(bent[None], truth), BODY, arm)["error_abs_mm"] == pytest.approx(forearm / 2)


def test_the_yardstick_is_a_forearm_at_the_persons_depth():
    pose = standing()
    truth = Truth(joints=joints(SKELETON, pose[None])[0])
    errors = step_errors(step_of(pose[None], truth), BODY)
    # 700 px focal length; the camera is 7 m to the side, and the joints lie symmetrically about that distance
    assert errors["forearm_px"] == pytest.approx(700 * sum(BODY.shape.forearm_radii) / 7.0)


def test_joints_behind_the_camera_are_missed_by_the_images_diagonal():
    pose = standing()
    behind = pose + np.eye(25)[1] * -20.0  # the camera stands 7 m to that side
    truth = Truth(pose=pose, joints=joints(SKELETON, pose[None])[0])
    errors = step_errors(step_of(behind[None], truth), BODY)
    assert errors["error_px"] == pytest.approx(np.hypot(640, 480))
    assert errors["humaneva_px"] == pytest.approx(np.hypot(640, 480))
    half = joints(SKELETON, pose[None])[0].copy()
    half[4:] = np.nan  # a truth that is not known is no miss
    assert step_errors(step_of(pose[None], Truth(joints=half)), BODY)["error_px"] == pytest.approx(0.0, abs=1e-9)


def test_no_truth_no_errors():
    step = step_of(standing()[None], Truth())
    assert step_errors(step, BODY) == {}
