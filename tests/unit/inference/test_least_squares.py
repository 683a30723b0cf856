"""The fit and its steps: moments of the particles, determinism, and sequences of any length."""

from itertools import pairwise

import numpy as np
import pytest
from least_squares_scenes import EVERY_JOINT, WALKER, decoder, joint_residuals, walk

from workbench.body.kinematics import joints
from workbench.core.discrepancy import Discrepancy
from workbench.core.frame import Frame
from workbench.core.residual import SQUARED, Loss
from workbench.inference.least_squares.frame_by_frame import fit_poses, pose_prior
from workbench.inference.least_squares.least_squares import steps
from workbench.inference.least_squares.motion_fit import fit_from, fit_sequence, restart
from workbench.inference.least_squares.residuals import joint_residual
from workbench.inference.least_squares.single_frame import FitData, MotionDecoder, PoseDecoder
from workbench.inference.least_squares.systematic_errors import SharedErrors

ROBUST = Loss("geman_mcclure", 3.0)


def frames(times):
    return [Frame(index=t, time_s=time, views=()) for t, time in enumerate(times)]


def sequence(n_frames=10, frames_per_style=1, phases=None, **scene):
    times, states = walk(n_frames)
    start = decoder().poses(states)[0]
    start[:6] += 0.03
    fit = fit_sequence(
        MotionDecoder(WALKER, decoder().model, start),
        FitData(joint_residuals(states, noise_m=0.01, **scene), times, ROBUST), frames_per_style, phases=phases,
    )  # fmt: skip
    return fit, states, times


@pytest.mark.parametrize("phases", [None, (0.1, 0.1 + 9.0 / 14.0), (0.05, 0.85)], ids=["found", "given", "given badly"])
@pytest.mark.parametrize("frames_per_style", [10, 5, 1])
def test_a_sequence_is_fitted_from_a_rough_start(frames_per_style, phases):
    fit, states, _ = sequence(frames_per_style=frames_per_style, phases=phases, outliers=0.15)
    truth, found = (joints(WALKER, poses) for poses in (decoder().poses(states), fit.poses))
    # eight joints with 1 cm of noise determine far fewer unknowns: the error is below the noise
    assert np.linalg.norm(found - truth, axis=2).mean() < 0.01
    assert all(later <= earlier for earlier, later in pairwise(fit.costs))
    assert fit.inliers.mean() == pytest.approx(0.85, abs=0.1)
    assert len(np.unique(fit.states[:, :2], axis=0)) == 10 // frames_per_style
    assert set(fit.timing_s) == {"start", "least_squares"}


def test_a_stalled_phase_is_searched_anew_from_the_worst_frames():
    times, states = walk(30)
    data = FitData(joint_residuals(states, noise_m=0.01), times, ROBUST)
    assert restart(decoder(), data, data, states) is None
    stalled = states.copy()
    stalled[12:, 2] = states[12, 2]
    found = restart(decoder(), data, data, stalled)
    first = int(np.flatnonzero((found != stalled).any(axis=1))[0])
    assert 12 <= first <= 22
    np.testing.assert_allclose(found[first:, 2], states[first:, 2], atol=0.05)


@pytest.mark.parametrize("n_frames", [1, 2, 3])
def test_short_sequences_are_fitted_too(n_frames):
    fit, states, times = sequence(n_frames)
    assert fit.poses.shape == (n_frames, 10)
    assert np.abs(joints(WALKER, fit.poses) - joints(WALKER, decoder().poses(states))).max() < 0.05
    assert len(list(steps(fit, frames(times), 5, np.random.default_rng(0)))) == n_frames


def test_particles_are_drawn_from_the_posterior():
    fit, _, times = sequence()
    n = 20_000
    for t, step in enumerate(steps(fit, frames(times), n, np.random.default_rng(0))):
        np.testing.assert_array_equal(step.expected_pose, fit.poses[t])
        np.testing.assert_array_equal(step.map_pose, fit.poses[t])
        assert np.exp(step.log_weights).sum() == pytest.approx(1.0)
        assert step.ess == n
        assert step.frame.index == t
        # a sample's mean is good to 1/√n of a deviation, its covariance to √(2/n): five times that
        deviations = np.sqrt(np.diagonal(fit.covariance[t])) + 1e-12
        np.testing.assert_allclose((step.poses.mean(axis=0) - fit.poses[t]) / deviations, 0.0, atol=5.0 / np.sqrt(n))
        apart = (np.cov(step.poses.T) - fit.covariance[t]) / np.outer(deviations, deviations)
        np.testing.assert_allclose(apart, 0.0, atol=5.0 * np.sqrt(2.0 / n))
        spread = np.sqrt(np.diagonal(fit.state_covariance[t]))
        apart = (np.cov(step.particles.T) - fit.state_covariance[t]) / np.outer(spread, spread)
        np.testing.assert_allclose(apart, 0.0, atol=5.0 * np.sqrt(2.0 / n))
        phase = step.particles[:, step.space.slices["phase"]]
        assert 0.0 <= np.median(phase) % 1.0 == pytest.approx(fit.states[t, 2] % 1.0, abs=0.01)


def test_what_the_model_misses_is_in_the_poses_and_not_in_the_states():
    fit, _, times = sequence()
    missed = Discrepancy(WALKER.dof_names[6:8], np.array([[0.1], [0.05]]), np.array([0.1, 0.2]), np.zeros(2), 3)
    wider = fit.with_discrepancy(np.repeat(missed.covariance_root(WALKER.dof_names)[None], len(times), axis=0))
    added = wider.covariance[4] - fit.covariance[4]
    np.testing.assert_allclose(added[6:8, 6:8], missed.covariance, atol=1e-15)
    assert np.count_nonzero(added) == 4
    n = 20_000
    step, plain = (next(steps(one, frames(times), n, np.random.default_rng(0))) for one in (wider, fit))
    np.testing.assert_array_equal(step.particles, plain.particles)
    np.testing.assert_array_equal(step.expected_pose, plain.expected_pose)
    deviations = np.sqrt(np.diagonal(wider.covariance[0])) + 1e-12
    apart = (np.cov(step.poses.T) - wider.covariance[0]) / np.outer(deviations, deviations)
    np.testing.assert_allclose(apart, 0.0, atol=5.0 * np.sqrt(2.0 / n))


@pytest.mark.parametrize("frames_per_style", [1, 10])
def test_what_a_fit_makes_of_a_person_unlike_the_model_is_foreseen(frames_per_style):
    """A little of it: a knee that is always more bent, and what then becomes of root and style."""
    times, states = walk(10)
    unlike = np.zeros((10, 1))
    unlike[WALKER.dof_names.index("left_knee_flexion")] = 1e-4
    poses = decoder().poses(states)

    def fitted(poses, missed=None):
        seen = [joint_residual(WALKER, EVERY_JOINT, points, 1e-5) for points in joints(WALKER, poses)]
        return fit_from(decoder(), FitData(seen, times, SQUARED), frames_per_style, states, 40, discrepancy=missed)

    model, person = fitted(poses, unlike), fitted(poses + unlike[:, 0])
    off = person.poses - (poses + unlike[:, 0]) - (model.poses - poses)
    np.testing.assert_allclose(off, -model.discrepancy_root[:, :, 0], atol=2e-6)  # first order: 2 % of it
    assert np.abs(off[:, :6]).max() > 1e-5


@pytest.mark.parametrize("frames_per_style", [1, 10])
@pytest.mark.parametrize("displaced", [3, None], ids=["one part", "all"])
def test_what_a_fit_makes_of_points_displaced_together_is_foreseen(frames_per_style, displaced):
    times, states = walk(10)
    poses, parts = decoder().poses(states), np.repeat(EVERY_JOINT, 3)  # a joint's three residuals are a part
    shared = SharedErrors(1e-4, [lambda pose: parts] * 10, len(EVERY_JOINT))

    def fitted(moved_m, shared=None):
        places = joints(WALKER, poses)
        places[:, slice(None) if displaced is None else displaced, 1] += moved_m
        seen = [joint_residual(WALKER, EVERY_JOINT, points, 1e-5) for points in places]
        return fit_from(decoder(), FitData(seen, times, SQUARED), frames_per_style, states, 40, shared=shared)

    still, moved = fitted(0.0, shared), fitted(1e-4)
    part = len(EVERY_JOINT) if displaced is None else displaced
    foreseen = still.discrepancy_root.reshape(10, 10, -1, 3)[:, :, part, 1]
    off = still.poses - moved.poses
    assert np.linalg.norm(off - foreseen) < 0.1 * np.linalg.norm(foreseen)  # first order, and where the search ends
    assert np.abs(foreseen).max() > 1e-5
    if displaced is None:
        np.testing.assert_allclose(-foreseen[:, 1], 1e-4, rtol=1e-3)  # all points go aside, and the root with them


@pytest.mark.slow
def test_the_band_covers_the_truth_as_often_as_it_says():
    inside = []
    for seed in range(8):
        fit, states, _ = sequence(seed=seed)
        deviations = np.sqrt(np.diagonal(fit.covariance, axis1=1, axis2=2))
        inside.append(np.abs(fit.poses - decoder().poses(states)) < 1.645 * deviations)
    # 90 % of 8 · 10 · 10 numbers, which within a walk go together: some 8 · 20 independent ones, deviation 2.4 %
    assert np.mean(inside) == pytest.approx(0.9, abs=0.07)


@pytest.mark.parametrize("prior", [None, decoder()], ids=["alone", "under the model's poses"])
def test_without_a_model_the_state_is_the_pose(prior):
    times, states = walk(6)
    truth = decoder().poses(states)
    data = FitData(joint_residuals(states, noise_m=0.005), times, ROBUST)
    fit = fit_poses(PoseDecoder(WALKER), data, truth[0], prior and pose_prior(prior))
    assert np.abs(joints(WALKER, fit.poses) - joints(WALKER, truth)).max() < 0.03
    np.testing.assert_array_equal(fit.states, fit.poses)
    step = next(steps(fit, frames(times), 50, np.random.default_rng(0)))
    np.testing.assert_array_equal(step.particles, step.poses)
    assert step.space.names == WALKER.dof_names
