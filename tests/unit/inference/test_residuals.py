"""What a fit believes of poses: derivatives, the centre of mass, the ground, and limbs turned over in depth."""

import numpy as np
import pytest
from keypoint_scenes import BODY, CAMERA, PX_M

from workbench.body.kinematics import joints
from workbench.core.pose_prior import PosePrior
from workbench.inference.least_squares.limb_flips import FLIP_SIGMA_M, LIMBS, flip_intervals, flipped
from workbench.inference.least_squares.residuals import (
    balance_residual,
    centre_of_mass,
    gaussian_residual,
    ground_residual,
    nominal_pose_residual,
)
from workbench.inference.least_squares.smooth_fit import pose_prior_gaussians

SKELETON = BODY.skeleton
STANDING = np.zeros(25)
STANDING[2] = 0.95
LEFT_LEG = [SKELETON.dof(f"left_{name}") for name in ("hip_flexion", "hip_abduction", "hip_twist", "knee_flexion")]


WIDE = np.eye(21) + 0.5
POSE_PRIOR_POWER = PosePrior(
    np.array([0.3, 0.7]), np.outer([0.4, -0.2], np.ones(21)), np.array([0.04 * np.eye(21), WIDE])
)
"""Two: one that is narrow, and one whose angles go together."""


def posture_residual(pose, covariance, power):
    """How far poses are off POSTURES, to a power, of which `pose` with this covariance may be."""
    means, precisions = pose_prior_gaussians(POSE_PRIOR_POWER, pose[None], covariance[None], power)
    return gaussian_residual(means[0], precisions[0])


def posed(**angles):
    pose = STANDING.copy()
    for name, angle in angles.items():
        pose[SKELETON.dof(name)] = angle
    return pose


@pytest.mark.parametrize(
    "residual", [
        nominal_pose_residual(SKELETON), balance_residual(SKELETON), ground_residual(SKELETON, 0.1),
        posture_residual(STANDING, 0.01 * np.eye(25), 0.3),
    ], ids=["usual", "balance", "ground", "postures"],
)  # fmt: skip
@pytest.mark.parametrize("seed", range(3))
def test_slopes_lead_downhill_as_finite_differences_say(residual, seed):
    pose = STANDING + 0.3 * np.random.default_rng(seed).standard_normal(25)
    misses, slopes = residual(pose)
    moves = 1e-6 * np.eye(25)
    costs = [0.5 * (residual(pose + sign * move)[0] ** 2).sum() for move in moves for sign in (1.0, -1.0)]
    exact = np.diff(np.reshape(costs, (-1, 2)), axis=1)[:, 0] / -2e-6
    np.testing.assert_allclose(misses @ slopes, exact, atol=1e-5 * max(1.0, np.abs(exact).max()))


def test_a_posture_is_off_those_that_it_may_be_of_and_the_root_is_free():
    near, apart = posed(root_x=2.0), np.linspace(-0.1, 0.3, 21)
    near[4:] = -0.2  # the second part's mean
    moved = near + np.concatenate([np.ones(4), apart])
    misses, slopes = posture_residual(near, 1e-6 * np.eye(25), 0.25)(moved)
    assert not slopes[:, :4].any()
    assert 0.5 * misses @ misses == pytest.approx(0.25 * 0.5 * apart @ np.linalg.solve(WIDE, apart), rel=1e-3)


def test_balance_is_told_in_deviations_ahead_and_to_the_left():
    turned = posed(root_heading=np.pi / 2.0, root_x=3.0)
    for pose in (STANDING, turned):  # upright the centre of mass is above the ankles but for the head, 2 mm ahead
        ahead, left = balance_residual(SKELETON)(pose)[0]
        assert ahead == pytest.approx(-0.043 / 0.05, abs=0.05)
        assert left == pytest.approx(0.0, abs=1e-9)
    leaning = posed(root_pitch=0.3)
    off = centre_of_mass(SKELETON) @ joints(SKELETON, leaning[None])[0]
    ankles = joints(SKELETON, leaning[None])[0, [SKELETON.joint("left_ankle"), SKELETON.joint("right_ankle")]]
    expected = (off[0] - ankles[:, 0].mean() - 0.043) / 0.05
    assert balance_residual(SKELETON)(leaning)[0] == pytest.approx([expected, 0.0], abs=1e-9)


def test_the_centre_of_mass_of_who_stands_is_at_the_height_of_the_navel():
    weights = centre_of_mass(SKELETON)
    assert weights.sum() == pytest.approx(1.0)
    height = (weights @ joints(SKELETON, STANDING[None])[0])[2] - 0.95 + 0.53 * 1.75  # the hips are at 0.53 H
    # Winter 2009 has 0.55 to 0.57 H for women and men; the neck is 0.03 H above the shoulders, for half of the body
    assert height / 1.75 == pytest.approx(0.56 + 0.5 * 0.5 * 0.03, abs=0.02)


def test_the_lower_foot_is_on_the_ground():
    lifted = posed(left_hip_flexion=1.2, left_knee_flexion=1.2)
    low = joints(SKELETON, lifted[None])[0, SKELETON.joint("right_ankle"), 2]
    misses, slopes = ground_residual(SKELETON, 0.05)(lifted)
    assert misses == pytest.approx([(low - 0.05) / 0.03])
    assert not slopes[0, LEFT_LEG].any()


def test_flips_look_the_same_and_are_at_the_other_depth():
    bent = {"left_hip_flexion": 0.5, "left_knee_flexion": 0.9, "right_hip_flexion": 0.5, "right_knee_flexion": 0.9}
    arms = {"left_elbow_flexion": 0.8, "right_elbow_flexion": 0.8}
    poses = np.repeat(posed(root_heading=-0.6, **bent, **arms)[None], 4, axis=0)
    whole = flip_intervals(SKELETON, CAMERA, poses)
    assert [(stretch.first, stretch.last) for stretch in whole] == 4 * [(0, 4)]  # as none lies across the view
    ends = []
    for limb, stretch in zip(LIMBS, whole, strict=True):
        middle, end = (SKELETON.joint(name) for name in limb[1:])
        over = flipped(SKELETON, CAMERA, poses, stretch.limb)
        before, after = (joints(SKELETON, some)[0] for some in (poses, over))
        across = np.linalg.norm(CAMERA.project(after) - CAMERA.project(before), axis=1)[end]
        depths = [CAMERA.to_camera(places)[[middle, end], 2] for places in (before, after)]
        if across * PX_M < FLIP_SIGMA_M:
            assert np.diff(depths[1]) * np.diff(depths[0]) < 0.0
            ends.append(limb[2])
    assert {"left_wrist", "right_wrist"} <= set(ends)  # the body's limits forbid some of the others
