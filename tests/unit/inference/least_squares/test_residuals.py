"""Residuals of a pose: derivatives, pose prior, balance, ground; and limbs flipped in depth."""

import numpy as np
import pytest
from keypoint_scenes import BODY, CAMERA, PX_M

from tests.oracles.smooth_poses import balance_residual, gaussian_residual, ground_residual, nominal_pose_residual
from workbench.body.centre_of_mass import centre_of_mass
from workbench.body.kinematics import joints
from workbench.core.pose_prior import PosePrior
from workbench.inference.least_squares.motion.smooth_fit import pose_prior_gaussians
from workbench.inference.least_squares.video.limb_flips import FLIP_SIGMA_M, LIMBS, flip_intervals, flipped

SKELETON = BODY.skeleton
STANDING = np.zeros(25)
STANDING[2] = 0.95
LEFT_LEG = [SKELETON.dof(f"left_{name}") for name in ("hip_flexion", "hip_abduction", "hip_twist", "knee_flexion")]


CORRELATED = np.eye(21) + 0.5
POSE_PRIOR = PosePrior(
    np.array([0.3, 0.7]), np.outer([0.4, -0.2], np.ones(21)), np.array([0.04 * np.eye(21), CORRELATED])
)
"""A narrow component and a component of correlated angles."""


def pose_prior_residual(pose, covariance, power):
    """Return the residual of a power of POSE_PRIOR for an estimate `pose` with a covariance."""
    means, precisions = pose_prior_gaussians(
        POSE_PRIOR, pose[None], covariance[None], power, (np.zeros(25), np.eye(25))
    )
    return gaussian_residual(means[0], precisions[0])


def posed(**angles):
    pose = STANDING.copy()
    for name, angle in angles.items():
        pose[SKELETON.dof(name)] = angle
    return pose


@pytest.mark.parametrize(
    "residual", [
        nominal_pose_residual(SKELETON), balance_residual(SKELETON), ground_residual(SKELETON, 0.1),
        pose_prior_residual(STANDING, 0.01 * np.eye(25), 0.3),
    ], ids=["nominal pose", "balance", "ground", "pose prior"],
)  # fmt: skip
@pytest.mark.parametrize("seed", range(3))
def test_gradients_equal_finite_differences(residual, seed):
    pose = STANDING + 0.3 * np.random.default_rng(seed).standard_normal(25)
    values, jacobian = residual(pose)
    steps = 1e-6 * np.eye(25)
    costs = [0.5 * (residual(pose + sign * step)[0] ** 2).sum() for step in steps for sign in (-1.0, 1.0)]
    gradient = np.diff(np.reshape(costs, (-1, 2)), axis=1)[:, 0] / 2e-6
    np.testing.assert_allclose(values @ jacobian, gradient, atol=1e-5 * max(1.0, np.abs(gradient).max()))


def test_the_pose_prior_is_that_of_the_responsible_component_and_leaves_the_root_free():
    mean, deviation = posed(root_x=2.0), np.linspace(-0.1, 0.3, 21)
    mean[4:] = -0.2  # of the second component
    pose = mean + np.concatenate([np.ones(4), deviation])
    values, jacobian = pose_prior_residual(mean, 1e-6 * np.eye(25), 0.25)(pose)
    assert not jacobian[:, :4].any()
    expected = 0.25 * 0.5 * deviation @ np.linalg.solve(CORRELATED, deviation)
    assert 0.5 * values @ values == pytest.approx(expected, rel=1e-3)


def test_balance_is_the_offset_of_the_centre_of_mass_forward_and_to_the_left():
    turned = posed(root_heading=np.pi / 2.0, root_x=3.0)
    for pose in (STANDING, turned):  # upright, only the head is not above the ankles: 2 mm of the centre of mass
        forward, left = balance_residual(SKELETON)(pose)[0]
        assert forward == pytest.approx(-0.043 / 0.05, abs=0.05)
        assert left == pytest.approx(0.0, abs=1e-9)
    leaning = posed(root_pitch=0.3)
    positions = joints(SKELETON, leaning[None])[0]
    ankles = positions[[SKELETON.joint("left_ankle"), SKELETON.joint("right_ankle")]].mean(axis=0)
    expected = ((centre_of_mass(SKELETON.names) @ positions - ankles)[0] - 0.043) / 0.05
    assert balance_residual(SKELETON)(leaning)[0] == pytest.approx([expected, 0.0], abs=1e-9)


def test_the_centre_of_mass_of_a_standing_person_is_at_the_published_height():
    weights = centre_of_mass(SKELETON.names)
    assert weights.sum() == pytest.approx(1.0)
    height = (weights @ joints(SKELETON, STANDING[None])[0])[2] - 0.95 + 0.53 * 1.75  # the hips are at 0.53 H
    # Winter (2009): 0.55 to 0.57 H. The neck is 0.03 H above the shoulders, which raises half of the body's mass.
    assert height / 1.75 == pytest.approx(0.56 + 0.5 * 0.5 * 0.03, abs=0.02)


def test_the_ground_residual_is_that_of_the_lower_foot():
    lifted = posed(left_hip_flexion=1.2, left_knee_flexion=1.2)
    height = joints(SKELETON, lifted[None])[0, SKELETON.joint("right_ankle"), 2]
    values, jacobian = ground_residual(SKELETON, 0.05)(lifted)
    assert values == pytest.approx([(height - 0.05) / 0.03])
    assert not jacobian[0, LEFT_LEG].any()


def test_flipped_limbs_have_the_same_image_and_the_opposite_depth():
    legs = {"left_hip_flexion": 0.5, "left_knee_flexion": 0.9, "right_hip_flexion": 0.5, "right_knee_flexion": 0.9}
    arms = {"left_elbow_flexion": 0.8, "right_elbow_flexion": 0.8}
    poses = np.repeat(posed(root_heading=-0.6, **legs, **arms)[None], 4, axis=0)
    intervals = flip_intervals(SKELETON, CAMERA, poses)
    assert [(interval.first, interval.last) for interval in intervals] == 4 * [(0, 4)]  # no limb is perpendicular
    same_image = []
    for limb, interval in zip(LIMBS, intervals, strict=True):
        middle, end = (SKELETON.joint(name) for name in limb[1:])
        before = joints(SKELETON, poses)[0]
        after = joints(SKELETON, flipped(SKELETON, CAMERA, poses, interval.limb))[0]
        change_px = np.linalg.norm(CAMERA.project(after) - CAMERA.project(before), axis=1)[end]
        depths = [CAMERA.to_camera(positions)[[middle, end], 2] for positions in (before, after)]
        if change_px * PX_M < FLIP_SIGMA_M:
            assert np.diff(depths[1]) * np.diff(depths[0]) < 0.0
            same_image.append(limb[2])
    assert {"left_wrist", "right_wrist"} <= set(same_image)  # the joint limits exclude some of the others
