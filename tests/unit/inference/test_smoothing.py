"""Fixed-lag smoothing and backward simulation against the exact smoother of a linear Gaussian model."""

import numpy as np
import pytest
from linear_gaussian import (
    MEAN0,
    LinearPrior,
    MemorylessFrameLikelihood,
    Position,
    assert_agree,
    exact,
    frames,
    moments,
    simulate,
    simulate_states,
    streams,
)

from workbench.evaluation.uncertainty.posterior_calibration import covered, weight_below
from workbench.inference.smc.bootstrap import Bootstrap
from workbench.inference.smc.particle_filter import ParticleFilter
from workbench.inference.smc.smoothing import BackwardSimulation, FixedLag

T, SEEDS = 8, 25


def particle_filter(measured, **model):
    return ParticleFilter(LinearPrior(), Position(measured, **model))


def moments_of_runs(smoother, **model):
    """Return mean and variance (T, n_seeds, 4) of every frame, and the measurements (T,)."""
    measured = simulate(T, seed=3, **model)
    runs = [smoother(particle_filter(measured, **model)).run(frames(T), MEAN0, streams(seed)) for seed in range(SEEDS)]
    estimates = [[np.concatenate(moments(step)) for step in steps] for steps in runs]
    return np.array(estimates).swapaxes(0, 1), measured


@pytest.mark.parametrize("model", [{}, {"h": -0.9, "sigma": 0.1}], ids=["position", "previous pose"])
def test_backward_simulation_converges_to_the_smoother(model):
    """With h the likelihood depends on the previous pose, as image motion does. About 50 effective particles remain on
    the trajectories, which need no restart from the filter."""
    options = {"n_particles": 150, "n_paths": 150}
    estimates, measured = moments_of_runs(lambda filter_: BackwardSimulation(filter_, **options), **model)
    mean, variance, _ = exact(measured, **model)
    for t in range(T):
        assert_agree(estimates[t], [*mean[t], *variance[t]])


@pytest.mark.parametrize("h", [0.0, -0.9])
def test_the_map_poses_are_those_of_the_trajectory_of_highest_density(h):
    filter_ = particle_filter(simulate(T, seed=3, h=h), h=h)
    smoother = BackwardSimulation(filter_, n_particles=150, n_paths=150, min_effective_ancestors=1)
    steps = list(smoother.run(frames(T), MEAN0, streams(0)))
    paths = np.stack([step.particles for step in steps])
    density = np.zeros(150)
    for before, now, frame in zip(paths[:-1], paths[1:], frames(T)[1:], strict=True):
        density += LinearPrior().log_transition(before, now, 0.1) + filter_.likelihood.log_prob(
            None, frame, before, now
        )
    np.testing.assert_array_equal([step.map_pose for step in steps], paths[:, np.argmax(density)])


@pytest.mark.parametrize("ess_threshold", [0.5, 1.0])
def test_fixed_lag_converges_to_the_posterior_given_three_more_frames(ess_threshold):
    options = {"n_particles": 500, "lag": 3, "min_effective_ancestors": 1}
    algorithm = Bootstrap(ess_threshold=ess_threshold)
    estimates, measured = moments_of_runs(lambda filter_: FixedLag(filter_.rebuilt(algorithm=algorithm), **options))
    for t in (0, 3, T - 3, T - 1):
        mean, variance, _ = exact(measured[: t + 4])
        assert_agree(estimates[t], [*mean[t], *variance[t]])


def assert_paths_of_the_filter(steps, filtered):
    """Assert that the ancestors of a smoother's steps are those of the filter's states."""
    for t in range(1, len(steps)):
        parents = filtered[t - 1].particles[filtered[t].ancestors]
        parent_of = {tuple(x): tuple(parent) for x, parent in zip(filtered[t].particles, parents, strict=True)}
        ancestors = steps[t - 1].particles[steps[t].ancestors]
        assert [parent_of[tuple(x)] for x in steps[t].particles] == [tuple(x) for x in ancestors]


@pytest.mark.parametrize(
    ("smoother", "options"),
    [
        (FixedLag, {"lag": 4}),
        (FixedLag, {"lag": 40, "min_effective_ancestors": 1}),
        (FixedLag, {"lag": 4, "min_effective_ancestors": 20}),
        (BackwardSimulation, {"n_paths": 20}),
    ],
)
def test_smoothed_steps_are_in_order_with_the_evidence_of_the_filter(smoother, options):
    measured = simulate(T, seed=0)
    inference = smoother(particle_filter(measured), n_particles=50, **options)
    steps = list(inference.run(frames(T), MEAN0, streams(1)))
    filtered = list(particle_filter(measured).rebuilt(n_particles=50).run(frames(T), MEAN0, streams(1)))
    assert [step.frame.index for step in steps] == list(range(T))
    assert sum(step.evaluations for step in steps) == inference.filter.likelihood.evaluated > 0
    assert [step.log_evidence for step in steps] == [step.log_evidence for step in filtered]
    for step in steps:
        assert step.expected_pose == pytest.approx(np.exp(step.log_weights) @ step.poses)
    if smoother is FixedLag:
        assert_paths_of_the_filter(steps, filtered)


@pytest.mark.parametrize(("h", "all_accepted"), [(0.0, True), (-0.9, False)])
def test_proposals_are_all_accepted_if_the_likelihood_ignores_the_previous_pose(h, all_accepted):
    options = {"n_particles": 60, "n_paths": 40, "n_mcmc_steps": 1, "min_effective_ancestors": 1}
    inference = BackwardSimulation(particle_filter(simulate(T, seed=0), h=h), **options)
    steps = list(inference.run(frames(T), MEAN0, streams(1)))
    assert all(step.diagnostics["acceptance_rate"] == 1.0 for step in steps[:-1]) == all_accepted


SMOOTHERS = {
    "fixed lag": lambda y, min_ancestors: FixedLag(
        ParticleFilter(LinearPrior(), y), n_particles=200, lag=15, min_effective_ancestors=min_ancestors
    ),
    "backward simulation": lambda y, min_ancestors: BackwardSimulation(
        ParticleFilter(LinearPrior(), y), n_particles=60, n_paths=200, min_effective_ancestors=min_ancestors
    ),
}


@pytest.mark.parametrize("name", SMOOTHERS)
def test_the_lag_is_shorter_where_few_ancestors_remain(name):
    likelihood = Position(simulate(40, seed=0, sigma=0.05), sigma=0.05)

    def lags_and_ess(min_ancestors):
        steps = list(SMOOTHERS[name](likelihood, min_ancestors).run(frames(40), MEAN0, streams(1)))
        if name == "backward simulation":
            filtered = [any("filtered" in message for message in step.warnings) for step in steps[:-1]]
            assert filtered == [step.diagnostics["lag"] == 0.0 for step in steps[:-1]]
        return np.array([[step.diagnostics["lag"], step.ess] for step in steps]).T

    lags, ess = lags_and_ess(1)
    following = 39 - np.arange(40)
    assert (lags == (np.minimum(15, following) if name == "fixed lag" else following)).all()
    assert ess.min() < 10
    lags, ess = lags_and_ess(20)
    assert (ess[lags > 0] >= 20).all()
    assert 0.0 < lags.mean() < 15.0
    assert (np.diff(lags) >= -1.0).all()  # the last frame used never decreases


def test_ancestors_follow_the_paths_of_the_filter_where_the_lag_increases():
    measured = simulate(40, seed=0, sigma=0.05)
    filtered = list(particle_filter(measured, sigma=0.05).rebuilt(n_particles=200).run(frames(40), MEAN0, streams(1)))
    steps = list(SMOOTHERS["fixed lag"](Position(measured, sigma=0.05), 20).run(frames(40), MEAN0, streams(1)))
    assert max(np.diff([step.diagnostics["lag"] for step in steps])) >= 2.0
    assert_paths_of_the_filter(steps, filtered)


@pytest.mark.parametrize("name", SMOOTHERS)
def test_intervals_of_enough_ancestors_cover_the_true_states(name):
    """90 % intervals of n ≥ 20 samples of the exact posterior have a coverage of 0.86 to 0.90."""
    n_runs, n_frames, coverage = 25, 15, {}
    for min_ancestors in (1, 20):
        inside = []
        for seed in range(n_runs):
            measured, states = simulate_states(n_frames, seed, sigma=0.05)
            smoother = SMOOTHERS[name](Position(measured, sigma=0.05), min_ancestors)
            for step in smoother.run(frames(n_frames), MEAN0, streams(seed)):
                below = weight_below(step.particles, np.exp(step.log_weights), states[step.frame.index])
                inside.append(covered(below, (0.9,)).mean())
        coverage[min_ancestors] = np.array(inside).reshape(n_runs, n_frames).mean(axis=1)
    error = coverage[20].std() / np.sqrt(n_runs)
    assert 0.86 - 4.0 * error < coverage[20].mean() < 0.90 + 4.0 * error
    gain = coverage[20] - coverage[1]
    assert gain.mean() > 4.0 * gain.std() / np.sqrt(n_runs)


class Forgetting(Position):
    """A likelihood whose update has no measurements of earlier frames."""

    def prepare(self, previous, frame):
        frame_likelihood = MemorylessFrameLikelihood(Position(self.measured, h=self.h), previous, frame)
        measured = np.where(np.arange(T) > frame.index, self.measured, 99.0)
        frame_likelihood.update = lambda expected: Forgetting(measured, h=self.h)
        return frame_likelihood


def test_backward_simulation_uses_the_likelihood_that_the_filter_had_in_each_frame():
    measured = simulate(T, seed=0)
    options = {"n_particles": 50, "n_paths": 20, "min_effective_ancestors": 1}
    expected, steps = (
        BackwardSimulation(ParticleFilter(LinearPrior(), y), **options).run(frames(T), MEAN0, streams(1))
        for y in (Position(measured, h=-0.5), Forgetting(measured, h=-0.5))
    )
    assert all((a.particles == b.particles).all() for a, b in zip(expected, steps, strict=True))
