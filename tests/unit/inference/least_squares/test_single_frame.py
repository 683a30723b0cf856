"""Fits of single frames, residual functions and the automatic initialization against known truth."""

import numpy as np
import pytest
from least_squares_scenes import EVERY_JOINT, WALKER, decoder, disturbed, joint_residuals, walk

from tests.oracles.smooth_poses import joint_residual
from workbench.body.angles import wrapped
from workbench.body.kinematics import joints
from workbench.cameras.camera import plain_camera
from workbench.core.losses import Loss
from workbench.core.observations import Keypoints
from workbench.core.prior import Smoothness
from workbench.core.residual import keypoint_residual
from workbench.inference.least_squares.motion.all_frames import fit_motion, fit_problem
from workbench.inference.least_squares.motion.first_frame import MIN_TRAVEL_M, likely_roots, roots_from_points
from workbench.inference.least_squares.motion.frame_by_frame import fit_poses
from workbench.inference.least_squares.motion.motion_decoder import MotionDecoder, follow, global_motion
from workbench.inference.least_squares.motion.phase_grid import N_PHASES, _dense_rates, best_lines, find_phase
from workbench.inference.least_squares.solver.single_frame import FitData, GaussianPrior, PoseDecoder, fit_frame
from workbench.utils.errors import InputError

SQUARED, ROBUST = Loss("squared", 1.0), Loss("geman_mcclure", 3.0)
CAMERA = plain_camera(640, 480, 700.0, (3.0, -3.0, 1.2), (1.3, 2.0, 0.9))


def keypoint_residuals(states):
    return [
        keypoint_residual(WALKER, CAMERA, EVERY_JOINT, np.column_stack([pixels, np.linspace(0.3, 1.0, 8)]), 2.0)
        for pixels in CAMERA.project(joints(WALKER, decoder().poses(states)))
    ]


@pytest.mark.parametrize("make", [joint_residuals, keypoint_residuals])
def test_the_jacobian_of_residuals_equals_finite_differences(make):
    _, states = walk(3)
    for residual, pose in zip(make(states), decoder().poses(disturbed(states)), strict=True):
        step = 1e-6 * np.eye(10)
        exact = np.stack([(residual(pose + move)[0] - residual(pose - move)[0]) / 2e-6 for move in step], axis=1)
        np.testing.assert_allclose(residual(pose)[1], exact, rtol=1e-6, atol=1e-6 * np.abs(exact).max())


def test_the_jacobian_of_the_decoder_equals_finite_differences():
    _, states = walk(4)
    step = 1e-6
    moves = step * np.eye(states.shape[1])
    exact = [(decoder().poses(states + move) - decoder().poses(states - move)) / (2 * step) for move in moves]
    np.testing.assert_allclose(decoder().jacobian(states), np.stack(exact, axis=-1), rtol=1e-6, atol=1e-8)


def test_keypoints_of_several_frames_determine_the_motion():
    times, states = walk(9)
    # A keypoint's deviation of 2 px is 1 cm at the walker's distance of 3.5 m; the bias by the priors is smaller.
    problem = fit_problem(
        decoder(), FitData(keypoint_residuals(states), times, Loss("huber", 1.0), Smoothness(style=0.01)), 1
    )
    estimate, _, _ = fit_motion(problem, disturbed(states), tolerance=1e-10, max_iterations=60)
    truth = joints(WALKER, decoder().poses(states))
    assert np.abs(joints(WALKER, decoder().poses(estimate)) - truth).max() < 0.01


def test_the_root_is_tracked_from_frame_to_frame():
    times, states = walk(12)
    truth = states.copy()
    states[:, -6:] = states[0, -6:] + np.array([0.05, -0.05, 0.03, 0.05, -0.05, 0.05])  # of the first frame only
    truth[:, 3] += 2.0 * np.arange(12) / 14.0  # a runner's speed, 23 cm per frame
    estimate = global_motion(decoder(), FitData(joint_residuals(truth), times, ROBUST), states)
    np.testing.assert_allclose(estimate, truth, atol=1e-4)


def test_root_phase_and_style_are_tracked():
    times, states = walk(20, rate_hz=1.1)
    states[10:, 2] += 0.02 * np.arange(10)  # the cycle rate increases
    estimate = follow(decoder(), FitData(joint_residuals(states), times, ROBUST), states[:4])
    # The rate changes by one deviation of its prior: the phase lags by at most that, and no more after four frames.
    np.testing.assert_allclose(estimate[:, 2], states[:, 2], atol=0.02)
    np.testing.assert_allclose(estimate[14:, 2], states[14:, 2], atol=0.002)
    np.testing.assert_allclose(estimate[:, 3:], states[:, 3:], atol=0.01)


def test_poses_are_tracked_without_a_motion_model():
    times, states = walk(6)
    truth = decoder().poses(states)
    fit = fit_poses(PoseDecoder(WALKER), FitData(joint_residuals(states), times, SQUARED), truth[0] + 0.02)
    np.testing.assert_allclose(fit.poses, truth, atol=1e-4)
    assert np.linalg.eigvalsh(fit.covariance).min() > 0.0
    pose = truth[0] + 0.02
    for residual in joint_residuals(states):
        search = fit_frame(PoseDecoder(WALKER), residual, SQUARED, pose)
        assert np.all(np.diff(search.costs) < 0.0)
        pose = search.x


def test_unobserved_angles_do_not_change_and_are_uncertain():
    times, states = walk(1)
    pose = decoder().poses(states)[0]
    foot = np.array([WALKER.joint("left_ankle")])
    residual = joint_residual(WALKER, foot, joints(WALKER, pose[None])[0, foot] + 0.02, 0.01)
    fit = fit_poses(PoseDecoder(WALKER), FitData([residual], times, SQUARED), pose)
    right_leg = [WALKER.dof("right_hip_flexion"), WALKER.dof("right_knee_flexion")]
    np.testing.assert_array_equal(fit.poses[0, right_leg], pose[right_leg])
    np.testing.assert_allclose(np.diagonal(fit.covariance[0])[right_leg], 1.0)


def test_a_linear_frame_with_a_gaussian_prior_has_the_closed_form():
    rng = np.random.default_rng(0)
    jacobian, measured = rng.standard_normal((14, 10)), rng.standard_normal(14)
    prior = GaussianPrior(rng.standard_normal(10), rng.standard_normal((6, 10)))
    search = fit_frame(
        PoseDecoder(WALKER), lambda pose: (jacobian @ pose - measured, jacobian), SQUARED, np.zeros(10), prior=prior,
        tolerance=1e-14,
    )  # fmt: skip
    precision = prior.whitening.T @ prior.whitening
    normal = jacobian.T @ jacobian + precision
    expected = np.linalg.solve(normal, jacobian.T @ measured + precision @ prior.mean)
    np.testing.assert_allclose(search.x, expected, atol=1e-6)
    np.testing.assert_allclose(search.quadratic.normal.dense(), normal, rtol=1e-12)


def test_the_line_of_least_cost_has_the_true_phase_and_rate():
    times, phase, rate = np.arange(8) / 14.0, 0.9, 1.2
    phases = np.arange(12) / 12.0
    costs = 1.0 - np.cos(2.0 * np.pi * (phases - (phase + rate * times)[:, None]))
    (cost, line), *others = best_lines(costs, times, np.array([0.8, 1.0, 1.2, 1.4]))
    np.testing.assert_allclose((line - phase - rate * times + 0.5) % 1.0 - 0.5, 0.0, atol=1.0 / 48.0)
    assert len(others) == 3
    assert all(cost < other for other, _ in others)


@pytest.mark.parametrize("duration_s", [0.5, 4.0])
def test_neighbouring_frequencies_end_less_than_a_phase_apart(duration_s):
    rates = np.array([0.6, 0.8, 1.0])
    dense = _dense_rates(rates, 3.0 + np.array([0.0, 0.1, duration_s]))
    n = int(np.ceil(0.4 * duration_s * N_PHASES))
    np.testing.assert_allclose(dense, rates if n < 3 else np.linspace(0.6, 1.0, n + 1))


def phase_error(seed):
    """Return the largest phase error, cycles, of the first frames of a walk at 0.8 or 1.2 times the model's rate."""
    rng = np.random.default_rng(seed)
    _, states = walk(8, rate_hz=rng.choice([0.8, 1.2]), phase=rng.random(), alpha=0.5 * rng.standard_normal(2))
    start = decoder().poses(states)[0]
    start[:6] += rng.standard_normal(6) * np.array([*[0.03] * 3, *[0.05] * 3])
    poses = MotionDecoder(WALKER, decoder().model, start)
    residuals = joint_residuals(states, sigma_m=0.02, noise_m=0.03, outliers=0.15, seed=seed)
    estimate = find_phase(poses, FitData(residuals, np.arange(8) / 14.0, ROBUST), start[:6])
    return np.abs((estimate[:, 2] - states[:, 2] + 0.5) % 1.0 - 0.5).max()


@pytest.mark.slow
def test_the_phase_is_estimated_in_95_percent_of_20_walks():
    assert np.mean([phase_error(seed) < 0.1 for seed in range(20)]) >= 0.95


def test_points_determine_position_and_heading_of_a_walker():
    times, states = walk(8)
    rng = np.random.default_rng(2)
    centres = joints(WALKER, decoder().poses(states))
    clouds = [np.repeat(points, 20, axis=0) + 0.05 * rng.standard_normal((160, 3)) for points in centres]
    clouds[3] = np.empty((0, 3))
    (root,) = roots_from_points(WALKER, clouds, times)
    assert np.linalg.norm(root[:3] - states[0, 3:6]) < 0.2
    assert abs(root[3] - np.arctan2(0.4, 1.2)) < 0.3


@pytest.mark.parametrize(("travel_m", "n_roots"), [(0.0, 8), (MIN_TRAVEL_M - 1e-6, 8), (MIN_TRAVEL_M + 1e-6, 1)])
def test_points_that_travel_by_a_tenth_of_a_metre_determine_the_heading(travel_m, n_roots):
    """The medians move along a line between frames 1 and 7, the others are empty; their line begins with frame 0."""
    times, middle = 5.0 + np.arange(12) / 10.0, np.array([1.0, -2.0, 0.9])
    velocity = travel_m / 0.6 * np.array([-0.6, 0.8, 0.5])
    around = np.array([[0.0, 0.0, 0.0], [0.3, -0.1, 0.5], [-0.2, 0.4, -0.6]])
    clouds = [middle + k / 10.0 * velocity + around if k in (1, 4, 7) else np.empty((0, 3)) for k in range(8)]
    roots = roots_from_points(WALKER, [*clouds, *[middle + 100.0 + around] * 4], times)
    headings = [np.arctan2(0.8, -0.6)] if n_roots == 1 else np.arange(8) * np.pi / 4.0
    assert roots[:, 3] == pytest.approx(np.array(headings))
    poses = np.concatenate([roots, np.zeros((n_roots, 4))], axis=1)
    np.testing.assert_allclose(joints(WALKER, poses).mean(axis=1), np.tile(middle, (n_roots, 1)), atol=1e-9)
    with pytest.raises(InputError, match="expected points in two"):
        roots_from_points(WALKER, clouds[:4], times[:4])


def test_the_best_root_over_phases_and_headings_is_the_true_one():
    """The phase is one of the grid, and the heading between two of its headings."""
    true = np.array([1.0, 1.5, 0.8, 0.3, 0.0, 0.0])
    pose = decoder().poses(decoder().states(np.zeros(2), np.array([5.0 / N_PHASES]), true))[0]
    pixels = CAMERA.project(joints(WALKER, pose[None])[0])
    view = Keypoints(EVERY_JOINT, np.column_stack([pixels, np.ones(8)]), CAMERA)
    roots = likely_roots(decoder(), [view], keypoint_residual(WALKER, CAMERA, EVERY_JOINT, view.detections, 2.0))
    assert roots[0] == pytest.approx(true, abs=0.02)
    assert len(roots) == 2
    assert np.abs(wrapped(roots[1, 3] - roots[0, 3])) > np.pi / 4.0


def test_a_model_of_another_skeleton_is_rejected():
    model = decoder().model
    model.angles = ("tail_flexion",)
    with pytest.raises(InputError, match="no joint angle called 'tail_flexion'"):
        MotionDecoder(WALKER, model, np.zeros(10))
