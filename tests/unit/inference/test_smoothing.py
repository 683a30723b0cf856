"""Smoothing against the exact posterior of a linear Gaussian model given all frames."""

import numpy as np
import pytest
from linear_gaussian import (
    MEAN0,
    LinearPrior,
    LookOf,
    Position,
    assert_agree,
    exact,
    frames,
    moments,
    simulate,
    simulate_states,
    streams,
)

from workbench.evaluation.posterior_calibration import covered, weight_below
from workbench.inference.smc.bootstrap import Bootstrap
from workbench.inference.smc.particle_filter import ParticleFilter
from workbench.inference.smc.smoothing import BackwardSimulation, FixedLag

T, SEEDS = 8, 25


def plain(measured, **model):
    return ParticleFilter(LinearPrior(), Position(measured, **model))


def rows(make, h=0.0):
    """Mean and variance (T, n_seeds, 4) of every frame, and what was measured."""
    measured = simulate(T, seed=3, h=h)
    runs = [
        [np.concatenate(moments(step)) for step in make(LinearPrior(), Position(measured, h=h)).run(*given)]
        for given in ((frames(T), MEAN0, streams(seed)) for seed in range(SEEDS))
    ]
    return np.array(runs).swapaxes(0, 1), measured


@pytest.mark.parametrize("h", [0.0, -0.9])
def test_backward_simulation_converges_to_the_smoother(h):
    """h: the likelihood looks at the previous pose as well, as image motion does."""
    options = {"n_particles": 150, "n_paths": 150, "n_mcmc_steps": 2, "min_effective_ancestors": 1}
    found, measured = rows(lambda p, y: BackwardSimulation(ParticleFilter(p, y), **options), h)
    mean, variance, _ = exact(measured, h=h)
    for t in (0, 5, T - 1):
        assert_agree(found[t], [*mean[t], *variance[t]])


@pytest.mark.parametrize("ess_threshold", [0.5, 1.0])
def test_fixed_lag_converges_to_the_posterior_given_that_many_frames_more(ess_threshold):
    options, move = {"n_particles": 500, "lag": 3, "min_effective_ancestors": 1}, Bootstrap(ess_threshold=ess_threshold)
    found, measured = rows(lambda p, y: FixedLag(ParticleFilter(p, y, algorithm=move), **options))
    for frame, seen in ((0, 4), (3, 7), (T - 3, T), (T - 1, T)):
        mean, variance, _ = exact(measured[:seen])
        assert_agree(found[frame], [*mean[frame], *variance[frame]])


def test_every_frame_is_told_once_in_order_and_ancestors_lead_along_the_paths():
    measured = simulate(T, seed=0)
    for inference in (
        FixedLag(plain(measured), n_particles=50, lag=4),
        FixedLag(plain(measured), n_particles=50, lag=40, min_effective_ancestors=1),
        FixedLag(plain(measured), n_particles=50, lag=4, min_effective_ancestors=20),
        BackwardSimulation(plain(measured), n_particles=50, n_paths=20),
    ):
        steps = list(inference.run(frames(T), MEAN0, streams(1)))
        assert [step.frame.index for step in steps] == list(range(T))
        assert sum(step.evaluations for step in steps) == inference.filter.likelihood.evaluated > 0
        own = list(plain(measured).rebuilt(n_particles=50).run(frames(T), MEAN0, streams(1)))
        for before, step, filtered in zip(steps, steps[1:], own[1:], strict=False):
            origin = {tuple(x): tuple(own[step.frame.index - 1].particles[a]) for x, a in
                      zip(filtered.particles, filtered.ancestors, strict=True)}  # fmt: skip
            parents = before.particles[step.ancestors]
            if isinstance(inference, FixedLag):  # a path of the filter's own ancestry
                assert [tuple(x) for x in parents] == [origin[tuple(x)] for x in step.particles]
            assert step.log_evidence == filtered.log_evidence
            assert step.expected_pose == pytest.approx(np.exp(step.log_weights) @ step.poses)


def test_one_move_accepts_every_proposal_where_the_previous_pose_does_not_matter():
    measured = simulate(T, seed=0)
    for h, accepted in ((0.0, True), (-0.9, False)):
        options = {"n_particles": 60, "n_paths": 40, "n_mcmc_steps": 1, "min_effective_ancestors": 1}
        inference = BackwardSimulation(plain(measured, h=h), **options)
        steps = list(inference.run(frames(T), MEAN0, streams(1)))
        assert all(step.diagnostics["acceptance_rate"] == 1.0 for step in steps[:-1]) == accepted


def test_paths_are_rejuvenated():
    """Ancestry alone leaves a handful of distinct first states; backward simulation does not."""
    measured = simulate(60, seed=0)
    distinct = []
    for inference in (
        FixedLag(plain(measured), n_particles=100, lag=100, min_effective_ancestors=1),
        BackwardSimulation(plain(measured), n_particles=100, n_paths=100, min_effective_ancestors=1),
    ):
        distinct.append(next(iter(inference.run(frames(60), MEAN0, streams(1)))).diagnostics["unique_particles"])
    assert distinct[0] < 10 < 30 < distinct[1]


MAKE = {
    "fixed lag": lambda y, least: FixedLag(
        ParticleFilter(LinearPrior(), y), n_particles=200, lag=15, min_effective_ancestors=least
    ),
    "backward simulation": lambda y, least: BackwardSimulation(
        ParticleFilter(LinearPrior(), y), n_particles=60, n_paths=200, min_effective_ancestors=least
    ),
}


@pytest.mark.parametrize("name", MAKE)
def test_a_frame_that_few_ancestors_are_left_of_is_told_fewer_frames_late(name):
    measured = simulate(40, seed=0, sigma=0.05)
    for least in (1, 20):
        steps = list(MAKE[name](Position(measured, sigma=0.05), least).run(frames(40), MEAN0, streams(1)))
        lags, left = (np.array(list(map(of, steps))) for of in (lambda s: s.diagnostics["lag"], lambda s: s.ess))
        if least == 1:
            full = np.minimum(15, 39 - np.arange(40)) if name == "fixed lag" else 39 - np.arange(40)
            assert (lags == full).all()
            assert left.min() < 10
        else:
            assert (left[lags > 0] >= 20).all()
            assert 0.0 < lags.mean() < 15.0
            assert (np.diff(lags) >= -1.0).all()  # a later frame is never told by an earlier one


def test_ancestors_lead_along_the_paths_where_the_lag_grows_too():
    measured = simulate(40, seed=0, sigma=0.05)
    given = frames(40), MEAN0
    filtered = list(plain(measured, sigma=0.05).rebuilt(n_particles=200).run(*given, streams(1)))
    steps = list(MAKE["fixed lag"](Position(measured, sigma=0.05), 20).run(*given, streams(1)))
    assert max(np.diff([step.diagnostics["lag"] for step in steps])) >= 2.0
    for t in range(1, 40):
        parents = filtered[t - 1].particles[filtered[t].ancestors]
        own = {tuple(x): tuple(parent) for x, parent in zip(filtered[t].particles, parents, strict=True)}
        led = steps[t - 1].particles[steps[t].ancestors]
        assert [own[tuple(x)] for x in steps[t].particles] == [tuple(x) for x in led]


@pytest.mark.parametrize("name", MAKE)
def test_bands_of_enough_ancestors_hold_the_truth_as_often_as_they_say(name):
    """Truths from the model itself: a band of n ≥ 20 draws holds it in 0.86 to 0.90 of all cases."""
    n_runs, n_frames, rates = 25, 15, {}
    for least in (1, 20):
        inside = []
        for seed in range(n_runs):
            measured, states = simulate_states(n_frames, seed, sigma=0.05)
            for step in MAKE[name](Position(measured, sigma=0.05), least).run(frames(n_frames), MEAN0, streams(seed)):
                shares = weight_below(step.particles, np.exp(step.log_weights), states[step.frame.index])
                inside.append(covered(shares, (0.9,)).mean())
        rates[least] = np.array(inside).reshape(n_runs, n_frames).mean(axis=1)
    error = rates[20].std() / np.sqrt(n_runs)
    assert 0.86 - 4.0 * error < rates[20].mean() < 0.90 + 4.0 * error
    gained = rates[20] - rates[1]  # ancestry alone does not reach it
    assert gained.mean() > 4.0 * gained.std() / np.sqrt(n_runs)


class Forgets(Position):
    """Judges as `Position`, but knows of no measurement after its frame any more."""

    def prepare(self, previous, frame):
        frame_likelihood = LookOf(Position(self.measured), previous, frame)
        frame_likelihood.update = lambda expected: Forgets(np.where(np.arange(T) > frame.index, self.measured, 99.0))
        return frame_likelihood


def test_paths_are_judged_by_the_look_that_the_filter_had():
    measured = simulate(T, seed=0)
    options = {"n_particles": 50, "n_paths": 20, "min_effective_ancestors": 1}
    for one, other in zip(
        *(
            BackwardSimulation(ParticleFilter(LinearPrior(), y), **options).run(frames(T), MEAN0, streams(1))
            for y in (Position(measured), Forgets(measured))
        ),
        strict=True,
    ):
        assert (one.particles == other.particles).all()
