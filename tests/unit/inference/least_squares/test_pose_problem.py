"""The problem of smooth poses equals the sum of its terms in plain NumPy, for keypoints and for residual functions."""

from dataclasses import replace

import numpy as np
import pytest
from keypoint_scenes import BODY
from view_scenes import CAMERAS, frames, observed, swinging

from tests.oracles.smooth_poses import expansion, joint_residual, limit_residual
from workbench.body.kinematics import joints
from workbench.core.losses import LOSSES, SQUARED, Loss
from workbench.core.observations import Observed
from workbench.core.prior import Smoothness
from workbench.core.residual import stacked
from workbench.inference.least_squares.solver.residuals import views_residual
from workbench.inference.least_squares.solver.single_frame import PoseDecoder, fit_frame
from workbench.inference.least_squares.solver.sparse_solver import minimise
from workbench.inference.least_squares.video.limb_flips import LIMBS, flip_limbs
from workbench.inference.least_squares.video.pose_problem import KeypointArrays, PoseProblem, reach_targets
from workbench.inference.least_squares.video.systematic_errors import default_length_uncertainty

SKELETON = BODY.skeleton
SIGMA_PX = 3.0
DISTORTED = tuple(replace(camera, distortion=np.array([-0.2, 0.05, 1e-3, -2e-3, 0.01])) for camera in CAMERAS)


def both_problems(n_frames, cameras=CAMERAS, loss="huber", ground_m=0.1):
    """Return the same problem with keypoints and with residual functions, and poses (T, P) with a large gradient."""
    rng, (times, poses) = np.random.default_rng(0), swinging(SKELETON, n_frames)
    observations = observed(SKELETON, frames(SKELETON, times, poses, cameras, 2.0))
    if n_frames > 3:
        observations[2] = Observed(observations[2].points)  # without keypoints
    contacts = rng.random((n_frames, 2)) < 0.6
    options = (times, Loss(loss, 2.0), Smoothness(), contacts, ground_m)
    keypoints = KeypointArrays.of(observations, lambda weights: np.sqrt(weights) / SIGMA_PX)
    residuals = [views_residual(SKELETON, frame.keypoints, SIGMA_PX, np.inf) for frame in observations]
    batch = PoseProblem(SKELETON, keypoints, *options)
    functions = replace(batch, keypoints=KeypointArrays.none(n_frames), residual_functions=residuals)
    return batch, functions, poses + 0.3 * rng.standard_normal(poses.shape)


def test_a_camera_that_turns_is_one_view_with_a_row_for_each_frame():
    times, poses = swinging(SKELETON, 3)
    (still,) = CAMERAS[:1]
    cameras = [replace(still, translation=still.translation + 0.1 * t) for t in range(3)]
    views = [observed(SKELETON, frames(SKELETON, times, poses, (camera,)))[t] for t, camera in enumerate(cameras)]
    keypoints = KeypointArrays.of(views, np.sqrt)
    np.testing.assert_array_equal(keypoints.rows, [camera.row for camera in cameras])
    assert np.unique(keypoints.cameras).tolist() == [0, 1, 2]
    assert not keypoints.views.any()
    problem = PoseProblem(SKELETON, keypoints, times, SQUARED, Smoothness(), np.zeros((3, 2), bool))
    np.testing.assert_allclose(problem.residuals(poses), 0.0, atol=1e-9)
    assert len(problem.select_frames(np.array([1])).keypoints.views) == keypoints.first[2] - keypoints.first[1]


def random_pose_prior(poses):
    root = np.random.default_rng(1).standard_normal((25, 25))
    root[:4] = 0.0
    return poses - 0.2, np.tile(root @ root.T + np.diag(np.r_[np.zeros(4), np.ones(21)]), (len(poses), 1, 1))


def assert_expansions_of_numpy(batch, functions, poses):
    cost, gradient, matrix, damping_diagonal = expansion(batch, functions.residual_functions, poses)
    for problem in (batch, functions):
        quadratic = problem.expand(poses.ravel())
        assert quadratic.cost == pytest.approx(cost, rel=1e-13)
        np.testing.assert_allclose(quadratic.gradient, gradient, rtol=0.0, atol=1e-12 * np.abs(gradient).max())
        np.testing.assert_allclose(quadratic.normal.dense(), matrix, rtol=0.0, atol=1e-12 * np.abs(matrix).max())
        np.testing.assert_allclose(quadratic.damping_diagonal, damping_diagonal, rtol=1e-11, atol=1e-20)


@pytest.mark.parametrize("n_frames", [1, 2, 3, 12])
@pytest.mark.parametrize("loss", LOSSES)
def test_the_expansion_is_that_of_numpy(n_frames, loss):
    assert_expansions_of_numpy(*both_problems(n_frames, loss=loss))


@pytest.mark.parametrize("cameras", [CAMERAS[:1], DISTORTED], ids=["one camera", "distortion"])
@pytest.mark.parametrize("ground_m", [None, 0.2])
@pytest.mark.parametrize("with_prior", [False, True])
def test_the_expansion_with_ground_and_pose_prior_is_that_of_numpy(cameras, ground_m, with_prior):
    batch, functions, poses = both_problems(8, cameras, ground_m=ground_m)
    pose_prior = random_pose_prior(poses) if with_prior else None
    assert_expansions_of_numpy(replace(batch, pose_prior=pose_prior), replace(functions, pose_prior=pose_prior), poses)


def test_joints_behind_a_camera_have_the_cost_of_numpy():
    batch, functions, poses = both_problems(3)
    poses[1, :3] = 2.0 * CAMERAS[0].position
    assert_expansions_of_numpy(batch, functions, poses)


@pytest.mark.parametrize("kind", [0, 1], ids=["keypoints", "functions"])
def test_a_window_has_the_blocks_and_the_cost_changes_of_all_frames(kind):
    *problems, poses = both_problems(14)
    batch = problems[kind]
    quadratic = batch.expand(poses.ravel())
    for first, last in ((0, 5), (4, 9), (13, 14), (0, 14)):
        block, window = slice(25 * first, 25 * last), batch.expand_frames(poses, first, last)
        np.testing.assert_allclose(window.gradient, quadratic.gradient[block], rtol=1e-12)
        dense = quadratic.normal.dense()[block, block]
        np.testing.assert_allclose(window.normal.dense(), dense, atol=1e-12 * np.abs(dense).max())
        changed = poses.copy()
        changed[first:last] += 0.01
        change = batch.expand(changed.ravel()).cost - quadratic.cost
        assert batch.cost_of_frames(changed, first, last) - window.cost == pytest.approx(change, rel=1e-9)


@pytest.mark.slow
def test_the_sequential_fit_is_that_of_the_residual_functions():
    batch, functions, poses = both_problems(5)
    np.testing.assert_allclose(batch.fit_sequentially(poses[0]), functions.fit_sequentially(poses[0]), atol=1e-9)


def test_limbs_reach_their_targets_as_by_the_residual_functions():
    _, _, poses = both_problems(6)
    limb = np.array([SKELETON.joint(name) for name in LIMBS[1]])
    targets = joints(SKELETON, poses)[:, limb[1:]] + 0.1
    free = np.flatnonzero(np.isin(SKELETON.dof_joints, limb[:2]))
    expected = poses.copy()
    for t, pose in enumerate(poses):
        residual = stacked([joint_residual(SKELETON, limb[1:], targets[t], 0.03), limit_residual(SKELETON, 0.05)])
        search = fit_frame(PoseDecoder(SKELETON), residual, SQUARED, pose, free=free, max_iterations=8, tolerance=1e-2)
        expected[t] = search.x
    np.testing.assert_allclose(reach_targets(SKELETON, poses, limb, targets, 0.03), expected, atol=1e-7)


def test_the_bias_by_wrong_lengths_is_the_shift_of_a_refit():
    batch, _, poses = both_problems(5, loss="squared", ground_m=None)
    batch = replace(batch, foot_contacts=np.zeros((5, 2), dtype=bool))
    cause = default_length_uncertainty(SKELETON).sum(axis=2, keepdims=True)
    longer = replace(SKELETON, offsets=SKELETON.offsets + 1e-4 * cause[..., 0])
    fit = minimise(batch.expand, poses.ravel(), max_iterations=200, tolerance=1e-14)
    refit = minimise(replace(batch, skeleton=longer).expand, fit.x, max_iterations=200, tolerance=1e-16)
    bias = batch.bias_sensitivity(fit.quadratic.normal.factor(), fit.x.reshape(poses.shape), cause)[..., 0]
    shift = (refit.x - fit.x).reshape(poses.shape) / 1e-4
    assert np.linalg.norm(bias + shift) < 0.25 * np.linalg.norm(shift)  # the change of the balance term is neglected


def test_a_limb_flipped_in_some_frames_is_flipped_back():
    times, poses = swinging(SKELETON, 40)
    poses[:, SKELETON.dof("left_elbow_flexion")] = 1.2
    observations = observed(SKELETON, frames(SKELETON, times, poses, CAMERAS[:1]))
    keypoints = KeypointArrays.of(observations, lambda weights: np.sqrt(weights) / SIGMA_PX)
    contacts = np.zeros((40, 2), dtype=bool)
    problem = PoseProblem(SKELETON, keypoints, times, Loss("huber", 3.0), Smoothness(), contacts)
    correct = minimise(problem.expand, poses.ravel())
    limb = np.array([SKELETON.joint(name) for name in LIMBS[0]])
    wrong, window = correct.x.reshape(poses.shape).copy(), slice(10, 30)
    targets = joints(SKELETON, wrong[window])[:, limb[1:]]
    rays = targets[:, 0] - CAMERAS[0].position
    rays /= np.linalg.norm(rays, axis=1, keepdims=True)
    targets[:, 1] -= 2.0 * ((targets[:, 1] - targets[:, 0]) * rays).sum(axis=1)[:, None] * rays
    wrong[window] = reach_targets(SKELETON, wrong[window], limb, targets, 0.03)
    local_minimum = minimise(problem.expand, wrong.ravel())
    flipped_back = flip_limbs(problem, CAMERAS[0], local_minimum.x.reshape(poses.shape))
    assert local_minimum.costs[-1] > correct.costs[-1] + 5.0
    assert minimise(problem.expand, flipped_back.ravel()).costs[-1] < correct.costs[-1] + 0.5
