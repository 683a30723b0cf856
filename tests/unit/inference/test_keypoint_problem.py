"""The fit of all frames' keypoints by kernels, against residual functions in plain NumPy, frame by frame."""

from dataclasses import replace

import numpy as np
import pytest
from keypoint_scenes import BODY
from view_scenes import CAMERAS, frames, observed, swinging

from workbench.body.kinematics import joints
from workbench.core.observations import Observed
from workbench.core.prior import Smoothness
from workbench.core.residual import LOSSES, SQUARED, Loss, stacked
from workbench.inference.least_squares.keypoint_problem import KeypointArrays, KeypointProblem, reach_targets
from workbench.inference.least_squares.limb_flips import LIMBS, flip_limbs
from workbench.inference.least_squares.residual_problem import ResidualProblem
from workbench.inference.least_squares.residuals import joint_residual, limit_residual, views_residual
from workbench.inference.least_squares.single_frame import PoseDecoder, fit_frame
from workbench.inference.least_squares.solver import minimise
from workbench.inference.least_squares.systematic_errors import default_length_uncertainty

SKELETON = BODY.skeleton
SIGMA_PX = 3.0
BENT = tuple(replace(camera, distortion=np.array([-0.2, 0.05, 1e-3, -2e-3, 0.01])) for camera in CAMERAS)


def both(n_frames, cameras=CAMERAS, loss="huber", ground_m=0.1, seed=0):
    """The same problem as a batch and as functions, and poses (T, P) about which it is not flat."""
    rng, (times, poses) = np.random.default_rng(seed), swinging(SKELETON, n_frames)
    seen = observed(SKELETON, frames(SKELETON, times, poses, cameras, 2.0))
    if n_frames > 3:
        seen[2] = Observed(seen[2].points)  # shows nothing
    stand = rng.random((n_frames, 2)) < 0.6
    rest = (times, Loss(loss, 2.0), Smoothness(), stand, ground_m)
    marks = KeypointArrays.of(seen, lambda weights: np.sqrt(weights) / SIGMA_PX)
    residuals = [views_residual(SKELETON, frame.keypoints, SIGMA_PX, np.inf) for frame in seen]
    batch, functions = KeypointProblem(SKELETON, marks, *rest), ResidualProblem(SKELETON, residuals, *rest)
    return batch, functions, poses + 0.3 * rng.standard_normal(poses.shape)


def some_postures(poses):
    root = np.random.default_rng(1).standard_normal((25, 25))
    root[:4] = 0.0
    return poses - 0.2, np.tile(root @ root.T + np.diag(np.r_[np.zeros(4), np.ones(21)]), (len(poses), 1, 1))


@pytest.mark.parametrize("n_frames", [1, 2, 3, 12])
@pytest.mark.parametrize("loss", LOSSES)
def test_one_evaluation_is_that_of_the_residuals(n_frames, loss):
    agree(*both(n_frames, loss=loss))


@pytest.mark.parametrize("cameras", [CAMERAS[:1], BENT], ids=["one", "bent"])
@pytest.mark.parametrize("ground_m", [None, 0.2])
@pytest.mark.parametrize("drawn", [False, True])
def test_one_evaluation_is_that_of_the_residuals_with_whatever_is_known(cameras, ground_m, drawn):
    batch, functions, poses = both(8, cameras, ground_m=ground_m)
    usual = some_postures(poses) if drawn else None
    agree(replace(batch, pose_prior=usual), replace(functions, pose_prior=usual), poses)


def test_a_joint_behind_the_camera_counts_as_it_does_in_the_residuals():
    batch, functions, poses = both(3)
    poses[1, :3] = 2.0 * CAMERAS[0].position
    agree(batch, functions, poses)


def agree(batch, functions, poses):
    found, exact = batch.expand(poses.ravel()), functions.expand(poses.ravel())
    assert found.cost == pytest.approx(exact.cost, rel=1e-13)
    np.testing.assert_allclose(found.gradient, exact.gradient, rtol=0.0, atol=1e-12 * np.abs(exact.gradient).max())
    whole = exact.normal.dense()
    np.testing.assert_allclose(found.normal.dense(), whole, rtol=0.0, atol=1e-12 * np.abs(whole).max())
    np.testing.assert_allclose(found.damping_diagonal, exact.damping_diagonal, rtol=1e-11, atol=1e-20)


def test_a_window_is_part_of_the_whole_and_its_cost_changes_as_the_whole_does():
    batch, _, poses = both(14)
    whole = batch.expand(poses.ravel())
    for first, last in ((0, 5), (4, 9), (13, 14), (0, 14)):
        own, part = slice(25 * first, 25 * last), batch.expand_frames(poses, first, last)
        np.testing.assert_allclose(part.gradient, whole.gradient[own], rtol=1e-12)
        dense = whole.normal.dense()[own, own]
        np.testing.assert_allclose(part.normal.dense(), dense, atol=1e-12 * np.abs(dense).max())
        moved = poses.copy()
        moved[first:last] += 0.01
        change = batch.expand(moved.ravel()).cost - whole.cost
        assert batch.cost_of_frames(moved, first, last) - part.cost == pytest.approx(change, rel=1e-9)


@pytest.mark.slow
def test_poses_are_followed_as_by_the_residuals():
    batch, functions, poses = both(10)
    np.testing.assert_allclose(batch.fit_sequentially(poses[0]), functions.fit_sequentially(poses[0]), atol=1e-9)


def test_a_limb_reaches_as_far_as_by_the_residuals():
    _, _, poses = both(6)
    limb = np.array([SKELETON.joint(name) for name in LIMBS[1]])
    aims = joints(SKELETON, poses)[:, limb[1:]] + 0.1
    own = np.flatnonzero(np.isin(SKELETON.dof_joints, limb[:2]))
    exact = poses.copy()
    for t, pose in enumerate(poses):
        near = stacked([joint_residual(SKELETON, limb[1:], aims[t], 0.03), limit_residual(SKELETON, 0.05)])
        decoder = PoseDecoder(SKELETON)
        exact[t] = fit_frame(decoder, near, SQUARED, pose, free=own, max_iterations=8, tolerance=1e-2).x
    np.testing.assert_allclose(reach_targets(SKELETON, poses, limb, aims, 0.03), exact, atol=1e-7)


def test_wrong_lengths_mislead_a_fit_as_finite_differences_say():
    batch, _, poses = both(5, loss="squared", ground_m=None)
    batch = replace(batch, foot_contacts=np.zeros((5, 2), dtype=bool))
    cause = default_length_uncertainty(SKELETON).sum(axis=2, keepdims=True)
    longer = replace(SKELETON, offsets=SKELETON.offsets + 1e-4 * cause[..., 0])
    here = minimise(batch.expand, poses.ravel(), max_iterations=200, tolerance=1e-14)
    there = minimise(replace(batch, skeleton=longer).expand, here.x, max_iterations=200, tolerance=1e-16)
    found = batch.bias_sensitivity(here.quadratic.normal.factor(), here.x.reshape(poses.shape), cause)[..., 0]
    moved = (there.x - here.x).reshape(poses.shape) / 1e-4
    assert np.linalg.norm(found + moved) < 0.25 * np.linalg.norm(moved)  # balance, which shifts too, is left out


def test_a_limb_turned_over_in_some_frames_is_turned_back():
    times, poses = swinging(SKELETON, 40)
    poses[:, SKELETON.dof("left_elbow_flexion")] = 1.2
    seen = observed(SKELETON, frames(SKELETON, times, poses, CAMERAS[:1]))
    marks = KeypointArrays.of(seen, lambda weights: np.sqrt(weights) / SIGMA_PX)
    stand = np.zeros((40, 2), dtype=bool)
    problem = KeypointProblem(SKELETON, marks, times, Loss("huber", 3.0), Smoothness(), stand)
    right = minimise(problem.expand, poses.ravel())
    limb = np.array([SKELETON.joint(name) for name in LIMBS[0]])
    wrong = right.x.reshape(poses.shape).copy()
    own = slice(10, 30)
    places = joints(SKELETON, wrong[own])[:, limb[1:]]
    rays = places[:, 0] - CAMERAS[0].position
    rays /= np.linalg.norm(rays, axis=1, keepdims=True)
    places[:, 1] -= 2.0 * ((places[:, 1] - places[:, 0]) * rays).sum(axis=1)[:, None] * rays
    wrong[own] = reach_targets(SKELETON, wrong[own], limb, places, 0.03)
    stuck = minimise(problem.expand, wrong.ravel())
    searched = flip_limbs(problem, CAMERAS[0], stuck.x.reshape(poses.shape))
    assert stuck.costs[-1] > right.costs[-1] + 5.0
    assert minimise(problem.expand, searched.ravel()).costs[-1] < right.costs[-1] + 0.5
