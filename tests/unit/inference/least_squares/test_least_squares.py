"""The least-squares fit of a motion: accuracy, calibrated covariances and the moments of the samples."""

from itertools import pairwise

import numpy as np
import pytest
from least_squares_scenes import EVERY_JOINT, WALKER, decoder, joint_residuals, walk

from tests.oracles.smooth_poses import joint_residual
from workbench.body.kinematics import joints
from workbench.core.discrepancy import Discrepancy
from workbench.core.frame import Frame
from workbench.core.losses import SQUARED, Loss
from workbench.inference.least_squares.least_squares import steps
from workbench.inference.least_squares.motion.frame_by_frame import fit_poses
from workbench.inference.least_squares.motion.motion_decoder import MotionDecoder
from workbench.inference.least_squares.motion.motion_fit import fit_from, fit_sequence, restart
from workbench.inference.least_squares.motion.shared_errors import SharedErrors
from workbench.inference.least_squares.solver.single_frame import FitData, PoseDecoder

ROBUST = Loss("geman_mcclure", 3.0)
TRUE_PHASES = (0.1, 0.1 + 9.0 / 14.0)
"""Of the first and the last of ten frames."""


def frames(times):
    return [Frame(index=t, time_s=time, views=()) for t, time in enumerate(times)]


def fitted_walk(n_frames=10, frames_per_style=1, phases=None, **noise):
    times, states = walk(n_frames)
    start = decoder().poses(states)[0]
    start[:6] += 0.03
    fit = fit_sequence(
        MotionDecoder(WALKER, decoder().model, start),
        FitData(joint_residuals(states, noise_m=0.01, **noise), times, ROBUST), frames_per_style, phases=phases,
    )  # fmt: skip
    return fit, states, times


@pytest.mark.parametrize("phases", [None, TRUE_PHASES, (0.05, 0.85)], ids=["searched", "true", "inaccurate"])
@pytest.mark.parametrize("frames_per_style", [10, 5, 1])
def test_a_walk_is_fitted_from_an_inaccurate_pose(frames_per_style, phases):
    fit, states, _ = fitted_walk(frames_per_style=frames_per_style, phases=phases, outliers=0.15)
    errors = joints(WALKER, fit.poses) - joints(WALKER, decoder().poses(states))
    # Eight joints with 1 cm of noise determine far fewer unknowns: the error is below the noise.
    assert np.linalg.norm(errors, axis=2).mean() < 0.01
    assert all(later <= earlier for earlier, later in pairwise(fit.costs))
    assert fit.inliers.mean() == pytest.approx(0.85, abs=0.1)
    assert len(np.unique(fit.states[:, :2], axis=0)) == 10 // frames_per_style
    assert set(fit.timing_s) == {"start", "least_squares"}


def test_a_stalled_phase_is_searched_again_from_the_worst_frames():
    times, states = walk(30)
    data = FitData(joint_residuals(states, noise_m=0.01), times, ROBUST)
    assert restart(decoder(), data, data, states) is None
    stalled = states.copy()
    stalled[12:, 2] = states[12, 2]
    restarted = restart(decoder(), data, data, stalled)
    first = int(np.flatnonzero((restarted != stalled).any(axis=1))[0])
    assert 12 <= first <= 22
    np.testing.assert_allclose(restarted[first:, 2], states[first:, 2], atol=0.05)


@pytest.mark.parametrize("n_frames", [1, 2, 3])
def test_short_sequences_are_fitted(n_frames):
    fit, states, times = fitted_walk(n_frames)
    assert fit.poses.shape == (n_frames, 10)
    assert np.abs(joints(WALKER, fit.poses) - joints(WALKER, decoder().poses(states))).max() < 0.05
    assert len(list(steps(fit, frames(times), 5, np.random.default_rng(0)))) == n_frames


def assert_moments(samples, mean, covariance):
    """Assert that samples (n, D) have a mean and covariance within five standard errors, 1/√n and √(2/n) deviations."""
    n, deviations = len(samples), np.sqrt(np.diagonal(covariance)) + 1e-12
    np.testing.assert_allclose((samples.mean(axis=0) - mean) / deviations, 0.0, atol=5.0 / np.sqrt(n))
    error = (np.cov(samples.T) - covariance) / np.outer(deviations, deviations)
    np.testing.assert_allclose(error, 0.0, atol=5.0 * np.sqrt(2.0 / n))


def test_particles_are_samples_of_the_posterior():
    fit, _, times = fitted_walk()
    n = 20_000
    for t, step in enumerate(steps(fit, frames(times), n, np.random.default_rng(0))):
        np.testing.assert_array_equal(step.expected_pose, fit.poses[t])
        np.testing.assert_array_equal(step.map_pose, fit.poses[t])
        assert np.exp(step.log_weights).sum() == pytest.approx(1.0)
        assert step.ess == n
        assert step.frame.index == t
        assert_moments(step.poses, fit.poses[t], fit.covariance[t])
        phase = step.particles[:, step.space.slices["phase"]].mean()
        assert phase % 1.0 == pytest.approx(fit.states[t, 2] % 1.0, abs=0.01)
        assert_moments(step.particles, [*fit.states[t, :2], phase, *fit.states[t, 3:]], fit.state_covariance[t])


def test_the_model_discrepancy_widens_the_poses_but_not_the_states():
    fit, _, times = fitted_walk()
    discrepancy = Discrepancy(WALKER.dof_names[6:8], np.array([[0.1], [0.05]]), np.array([0.1, 0.2]), np.zeros(2), 3)
    wider = fit.with_discrepancy(np.repeat(discrepancy.covariance_root(WALKER.dof_names)[None], len(times), axis=0))
    added = wider.covariance[4] - fit.covariance[4]
    expected = discrepancy.loadings @ discrepancy.loadings.T + np.diag(discrepancy.residual_std**2)
    np.testing.assert_allclose(added[6:8, 6:8], expected, atol=1e-15)
    assert np.count_nonzero(added) == 4
    step, plain = (next(steps(one, frames(times), 20_000, np.random.default_rng(0))) for one in (wider, fit))
    np.testing.assert_array_equal(step.particles, plain.particles)
    np.testing.assert_array_equal(step.expected_pose, plain.expected_pose)
    assert_moments(step.poses, wider.poses[0], wider.covariance[0])


@pytest.mark.parametrize("frames_per_style", [1, 10])
def test_the_bias_by_a_person_unlike_the_model_is_predicted(frames_per_style):
    """A knee that is always flexed a little more changes the estimated root and style."""
    times, states = walk(10)
    discrepancy = np.zeros((10, 1))
    discrepancy[WALKER.dof_names.index("left_knee_flexion")] = 1e-4
    poses = decoder().poses(states)

    def fitted(poses, discrepancy=None):
        residuals = [joint_residual(WALKER, EVERY_JOINT, points, 1e-5) for points in joints(WALKER, poses)]
        data = FitData(residuals, times, SQUARED)
        return fit_from(decoder(), data, frames_per_style, states, 40, discrepancy=discrepancy)

    model, person = fitted(poses, discrepancy), fitted(poses + discrepancy[:, 0])
    bias = person.poses - (poses + discrepancy[:, 0]) - (model.poses - poses)
    np.testing.assert_allclose(bias, -model.discrepancy_root[:, :, 0], atol=2e-6)  # first order: 2 % of the discrepancy
    assert np.abs(bias[:, :6]).max() > 1e-5


@pytest.mark.parametrize("frames_per_style", [1, 10])
@pytest.mark.parametrize("displaced", [3, None], ids=["one joint", "all joints"])
def test_the_bias_by_a_common_displacement_of_points_is_predicted(frames_per_style, displaced):
    times, states = walk(10)
    poses, groups = decoder().poses(states), np.repeat(EVERY_JOINT, 3)  # the three residuals of a joint are a group
    shared = SharedErrors(1e-4, [lambda pose: groups] * 10, len(EVERY_JOINT))

    def fitted(displacement_m, shared=None):
        points = joints(WALKER, poses)
        points[:, slice(None) if displaced is None else displaced, 1] += displacement_m
        residuals = [joint_residual(WALKER, EVERY_JOINT, frame_points, 1e-5) for frame_points in points]
        return fit_from(decoder(), FitData(residuals, times, SQUARED), frames_per_style, states, 40, shared=shared)

    true, biased = fitted(0.0, shared), fitted(1e-4)
    group = len(EVERY_JOINT) if displaced is None else displaced
    predicted = true.discrepancy_root.reshape(10, 10, -1, 3)[:, :, group, 1]
    error = true.poses - biased.poses - predicted
    assert np.linalg.norm(error) < 0.1 * np.linalg.norm(predicted)  # first order, and the tolerance of the search
    assert np.abs(predicted).max() > 1e-5
    if displaced is None:
        np.testing.assert_allclose(-predicted[:, 1], 1e-4, rtol=1e-3)  # the root moves with the points


@pytest.mark.slow
def test_90_percent_intervals_cover_90_percent_of_the_truth():
    covered = []
    for seed in range(8):
        fit, states, _ = fitted_walk(phases=TRUE_PHASES, seed=seed)
        deviations = np.sqrt(np.diagonal(fit.covariance, axis1=1, axis2=2))
        covered.append(np.abs(fit.poses - decoder().poses(states)) < 1.645 * deviations)
    # The 10 · 10 numbers of a walk are correlated: about 20 are independent, so the standard error is 2.4 %.
    assert np.mean(covered) == pytest.approx(0.9, abs=0.07)


def test_without_a_motion_model_the_state_is_the_pose():
    times, states = walk(6)
    truth = decoder().poses(states)
    data = FitData(joint_residuals(states, noise_m=0.005), times, ROBUST)
    fit = fit_poses(PoseDecoder(WALKER), data, truth[0])
    assert np.abs(joints(WALKER, fit.poses) - joints(WALKER, truth)).max() < 0.03
    np.testing.assert_array_equal(fit.states, fit.poses)
    step = next(steps(fit, frames(times), 50, np.random.default_rng(0)))
    np.testing.assert_array_equal(step.particles, step.poses)
    assert step.space.names == WALKER.dof_names
