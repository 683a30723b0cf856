"""Pose errors of a step against closed forms."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from single_steps import BODY, CAMERA, SKELETON, standing, step_of

from workbench.body.kinematics import joints
from workbench.body.limbs import person_with_feet
from workbench.core.frame import Truth
from workbench.evaluation.errors.pose_errors import (
    AccelerationError,
    acceleration_error,
    accelerations,
    angle_error_deg,
    geodesic_deg,
    joint_errors,
    mean_distance,
    moved_joints,
    procrustes,
    step_errors,
)


def test_a_shift_of_the_root_is_an_absolute_error_only():
    pose = standing()
    moved = pose + np.eye(25)[0] * 0.03
    truth = Truth(pose=pose, joints=joints(SKELETON, pose[None])[0])
    errors = step_errors(step_of(moved[None], truth), BODY)
    assert errors["mpjpe_abs_mm"] == pytest.approx(30)
    assert errors["humaneva_mm"] == pytest.approx(30)
    assert errors["pck_abs_150mm"] == 1.0
    for name in ("mpjpe_mm", "pa_mpjpe_mm", "mpjae_local_deg"):
        assert errors[name] == pytest.approx(0, abs=1e-9)
    # focal length 700 px, distance about 7 m: 30 mm are about 3 px
    assert errors["mpjpe_px"] == pytest.approx(3.0, abs=0.15)
    half_size = step_errors(step_of(moved[None], truth), BODY, image_scale=0.5)
    assert half_size["mpjpe_px"] == pytest.approx(2 * errors["mpjpe_px"])
    partial = truth.joints.copy()
    partial[[0, 5]] = np.nan
    errors = step_errors(step_of(moved[None], Truth(joints=partial)), BODY)
    assert errors["mpjpe_abs_mm"] == errors["humaneva_mm"] == pytest.approx(30)
    assert "mpjpe_mm" not in errors


def test_image_errors_project_the_truth_by_the_true_camera():
    pose, true_camera = standing(), replace(CAMERA, translation=CAMERA.translation + np.array([0.1, 0.0, 0.0]))
    truth = Truth(pose=pose, joints=joints(SKELETON, pose[None])[0], cameras=(true_camera,))
    at_truth = step_errors(step_of(pose[None], truth), BODY)
    assert at_truth["mpjpe_abs_mm"] == pytest.approx(0.0)
    for name in ("mpjpe_px", "humaneva_px"):
        assert at_truth[name] == pytest.approx(10.0, rel=0.05)  # 10 cm in 7 m at 700 px
    errors = step_errors(step_of(pose[None], Truth(joints=truth.joints, cameras=(CAMERA,))), BODY)
    assert errors["mpjpe_px"] == pytest.approx(0.0, abs=1e-9)


def test_image_errors_are_over_visible_annotations():
    pose = standing()
    annotations = CAMERA.project(joints(SKELETON, pose[None])[0])
    visible = np.ones(15, dtype=bool)
    annotations[3] += [30.0, 40.0]
    annotations[4:] = np.nan
    annotations[0] = np.nan
    errors = step_errors(step_of(pose[None], Truth(annotations=annotations, annotations_visible=visible)), BODY)
    assert errors["mpjpe_px"] == pytest.approx(50 / 3)
    visible[3] = False
    errors = step_errors(step_of(pose[None], Truth(annotations=annotations, annotations_visible=visible)), BODY)
    assert errors["mpjpe_px"] == pytest.approx(0, abs=1e-9)
    assert "mpjpe_abs_mm" not in errors


def test_errors_are_over_moving_joints():
    arm = ["left_shoulder_twist", "left_elbow_flexion"]
    names = [SKELETON.names[joint] for joint in moved_joints(SKELETON, arm)]
    assert names == ["left_elbow", "left_wrist"]  # the descendants of the rotating joints
    assert [SKELETON.names[joint] for joint in moved_joints(SKELETON, ["left_elbow_flexion"])] == ["left_wrist"]
    assert len(moved_joints(SKELETON, ["root_z"])) == len(moved_joints(SKELETON, ["root_roll"])) == 14
    pose = standing()
    bent = pose.copy()
    bent[SKELETON.dof("left_elbow_flexion")] = np.pi / 3
    truth = Truth(joints=joints(SKELETON, pose[None])[0])
    forearm = 0.146 * 1800
    # 60° move the wrist by the length of a forearm, one of fourteen joints or of the two moving ones
    assert step_errors(step_of(bent[None], truth), BODY, arm)["mpjpe_abs_mm"] == pytest.approx(forearm / 2)
    assert step_errors(step_of(bent[None], truth), BODY)["mpjpe_mm"] == pytest.approx(forearm / 14)


def test_the_forearm_width_is_projected_at_the_persons_depth():
    pose = standing()
    truth = Truth(joints=joints(SKELETON, pose[None])[0])
    errors = step_errors(step_of(pose[None], truth), BODY)
    # focal length 700 px; the depths of the joints are symmetric about the camera's distance of 7 m
    assert errors["forearm_width_px"] == pytest.approx(700 * sum(BODY.shape.forearm_radii) / 7.0)


def test_the_error_of_joints_behind_the_camera_is_the_image_diagonal():
    pose = standing()
    behind = pose + np.eye(25)[1] * -20.0  # the camera is at a distance of 7 m
    truth = Truth(pose=pose, joints=joints(SKELETON, pose[None])[0])
    errors = step_errors(step_of(behind[None], truth), BODY)
    assert errors["mpjpe_px"] == pytest.approx(np.hypot(640, 480))
    assert errors["humaneva_px"] == pytest.approx(np.hypot(640, 480))
    half = joints(SKELETON, pose[None])[0].copy()
    half[4:] = np.nan  # unknown joints have no error
    assert step_errors(step_of(pose[None], Truth(joints=half)), BODY)["mpjpe_px"] == pytest.approx(0.0, abs=1e-9)


def test_a_frame_without_truth_has_no_errors():
    step = step_of(standing()[None], Truth())
    assert step_errors(step, BODY) == {}


RNG = np.random.default_rng(3)
POINTS = RNG.standard_normal((9, 3))


def test_the_mean_distance_ignores_unknown_points():
    truth = POINTS.copy()
    truth[0] += [0.3, 0.0, 0.4]
    truth[1] = np.nan
    assert mean_distance(POINTS, truth) == pytest.approx(0.5 / 8)
    assert np.isnan(mean_distance(POINTS, np.full_like(truth, np.nan)))
    # pixels of several frames
    np.testing.assert_allclose(mean_distance(np.zeros((2, 4, 2)), np.full((2, 4, 2), 3.0)), np.sqrt(18.0))


def test_procrustes_errors_are_invariant_to_similarities_but_not_to_reflections():
    transformed = 0.7 * POINTS @ Rotation.from_rotvec([0.3, -1.0, 2.0]).as_matrix().T + [1.0, 2.0, 3.0]
    assert procrustes(transformed, POINTS) == pytest.approx(0.0, abs=1e-12)
    assert procrustes(POINTS * [1.0, 1.0, -1.0], POINTS) > 0.1
    missing = POINTS.copy()
    missing[4] = np.nan
    assert procrustes(transformed, missing) == pytest.approx(0.0, abs=1e-12)
    missing[4:] = missing[0] = np.nan
    assert np.isnan(procrustes(transformed, missing))
    assert np.isnan(procrustes(np.ones((9, 3)), POINTS))


def test_procrustes_error_of_a_bent_square():
    # the corners move up and down alternately; by symmetry the optimal rotation is the identity
    square = np.array([[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [-1.0, 0.0, 0.0], [0.0, -1.0, 0.0]])
    bent = square + np.array([0.0, 0.0, 0.1]) * np.array([1.0, -1.0, 1.0, -1.0])[:, None]
    scale = 4.0 / 4.04  # ⟨bent, square⟩ / ‖bent‖²
    expected = np.sqrt((1.0 - scale) ** 2 + (scale * 0.1) ** 2)
    assert procrustes(bent, square) == pytest.approx(expected)


def test_pck_is_the_fraction_of_joints_within_the_threshold():
    truth = np.zeros((6, 3))
    estimate = np.array([0.0, 0.0, 0.1, 0.149, 0.151, 9.0])[:, None] * [0.0, 1.0, 0.0]
    assert joint_errors(range(1, 6), estimate, truth)["pck_abs_150mm"] == pytest.approx(3 / 5)
    truth[5] = np.nan
    assert joint_errors(range(1, 6), estimate, truth)["pck_abs_150mm"] == pytest.approx(3 / 4)


def test_joints_of_the_expected_pose_are_cached_by_skeleton():
    step = step_of(standing()[None], None)
    frames, other = step.expected_frames(SKELETON), replace(SKELETON, offsets=2.0 * SKELETON.offsets)
    expected = joints(SKELETON, step.expected_pose[None])[0]
    np.testing.assert_array_equal(step.expected_joints(SKELETON), expected)
    assert step.expected_frames(SKELETON) is frames
    np.testing.assert_array_equal(step.expected_joints(other), joints(other, step.expected_pose[None])[0])


def test_accelerations_of_a_parabola_are_exact_at_irregular_times():
    times = np.array([0.0, 0.1, 0.25, 0.3, 0.7])
    truth = np.zeros((5, 2, 3))
    fall = truth + np.array([0.0, 0.0, -0.5 * 9.81])[None, None] * times[:, None, None] ** 2
    np.testing.assert_allclose(accelerations(fall, times)[:, 0], np.tile([0.0, 0.0, -9.81], (3, 1)), atol=1e-9)
    np.testing.assert_allclose(acceleration_error(fall + 5.0 * times[:, None, None], truth, times), 9.81)


def test_the_geodesic_angle_is_that_of_the_relative_rotation():
    axis = np.array([1.0, 2.0, -2.0]) / 3.0
    for angle in (0.0, 1e-9, 0.5, 3.0, np.pi):
        start = Rotation.from_rotvec([0.5, 0.2, -0.9])
        end = start * Rotation.from_rotvec(angle * axis)
        # the sine is accurate to rounding, 1e-16
        assert geodesic_deg(start.as_matrix(), end.as_matrix()) == pytest.approx(np.degrees(angle), rel=1e-6, abs=1e-12)


def test_the_angle_error_is_the_mean_over_rotating_joints():
    pose, bent = standing(), standing()
    bent[SKELETON.dof("left_elbow_flexion")] = 0.6
    bent[3] = 0.3  # local rotations of the other joints stay unchanged
    n_rotating = 10  # pelvis, neck, and shoulder, elbow, hip and knee of both sides
    assert angle_error_deg(SKELETON, bent, pose, SKELETON.dof_names) == pytest.approx(np.degrees(0.9) / n_rotating)
    arm = ["left_shoulder_twist", "left_elbow_flexion"]
    assert angle_error_deg(SKELETON, bent, pose, arm) == pytest.approx(np.degrees(0.6) / 2)


def test_the_acceleration_error_measures_jitter_but_no_offset():
    pose = standing()
    true = Truth(joints=joints(SKELETON, pose[None])[0])
    shifted = pose + np.eye(25)[0] * 0.5
    errors = []
    for jitter in (0.0, 0.01):
        measure = AccelerationError(SKELETON)
        for t in range(4):
            step = step_of((shifted + (-1) ** t * jitter * np.eye(25)[1])[None], true)
            error = measure.add(replace(step, frame=replace(step.frame, time_s=t / 20.0)))
        errors.append(error["acceleration_error_m_s2"])
    # second difference of ±1 cm at 20 Hz: 4 · 1 cm · 20² / s²
    assert errors == pytest.approx([0.0, 16.0], abs=1e-9)
    assert measure.add(step_of(shifted[None], Truth(pose=pose))) == {}


def test_the_image_error_is_the_mean_of_all_views():
    pose = standing()
    true = joints(SKELETON, pose[None])[0]
    step = step_of((pose + 0.03 * np.eye(25)[0])[None], Truth(joints=true))
    (front,) = step.frame.views
    far_camera = replace(front.camera, name="far", translation=front.camera.translation + np.array([0, 0, 7.0]))
    far = replace(front, camera=far_camera)
    errors = [
        step_errors(replace(step, frame=replace(step.frame, views=views)), BODY)["humaneva_px"]
        for views in ((front,), (far,), (front, far))
    ]
    assert errors[1] == pytest.approx(0.5 * errors[0], rel=0.02)  # twice the distance
    assert errors[2] == pytest.approx(0.5 * (errors[0] + errors[1]))


def test_the_errors_of_a_body_with_feet_are_those_without():
    feet = person_with_feet(BODY.shape)
    poses = standing() + 0.02 * np.random.default_rng(0).standard_normal((8, 25))
    truth = Truth(pose=standing(), joints=joints(SKELETON, standing()[None])[0])
    with_feet = step_of(np.pad(poses, ((0, 0), (0, 2)), constant_values=0.3), truth)
    assert feet.without_feet.skeleton.names == SKELETON.names
    assert BODY.without_feet is BODY
    plain = with_feet.first_parameters(25)
    assert step_errors(plain, feet.without_feet) == step_errors(step_of(poses, truth), BODY)
    assert with_feet.first_parameters(27) is with_feet
    same = replace(with_feet, map_pose=with_feet.expected_pose).first_parameters(25)
    assert same.map_pose is same.expected_pose
