"""Smoothing against the exact posterior of a linear Gaussian model given all frames."""

from itertools import pairwise

import numpy as np
import pytest
from linear_gaussian import (
    MEAN0,
    LinearPrior,
    Position,
    exact,
    frames,
    moments,
    simulate,
    simulate_states,
    streams,
)

from workbench.errors import InputError
from workbench.evaluation.calibration import covered
from workbench.inference.particle_filter import ParticleFilter
from workbench.inference.smoothing import BackwardSimulation, FixedLag
from workbench.priors.smooth import Smooth

T, SEEDS = 8, 30


def rows(make, h, frame, n_seeds=SEEDS):
    """Errors of mean and variance (n_seeds, 4) in one frame, against those given the frames up to `seen`."""
    measured = simulate(T, seed=3, h=h)
    found = []
    for seed in range(n_seeds):
        inference = make(LinearPrior(), Position(measured, h=h))
        step = list(inference.run(frames(T), MEAN0, streams(seed)))[frame]
        found.append(np.concatenate(moments(step)))
    return np.array(found), measured


def agrees(found, expected, n_particles):
    """The mean over seeds lies within 5 standard errors; a variance is biased by about itself over N as well."""
    error = 5 * found.std(axis=0) / np.sqrt(len(found))
    bias = np.array([0.0, 0.0, *(10 * expected[2:] / n_particles)])
    assert (np.abs(found.mean(axis=0) - expected) < error + bias).all()


@pytest.mark.parametrize("h", [0.0, -0.9])
@pytest.mark.parametrize("frame", [0, 5, T - 1])
def test_backward_simulation_converges_to_the_smoother(h, frame):
    """h: the likelihood looks at the previous pose as well, as image motion does."""
    n = 150
    found, measured = rows(
        lambda p, y: BackwardSimulation(p, y, n_particles=n, n_paths=n, moves=2, least_ancestors=1), h, frame
    )
    mean, variance, _ = exact(measured, h=h)
    agrees(found, np.concatenate([mean[frame], variance[frame]]), n)


def test_smoothing_is_needed_here():
    """The filter's own mean of frame 5 fails the smoother's test by far: what is tested above is no triviality."""
    found, measured = rows(lambda p, y: ParticleFilter(p, y, n_particles=400), 0.0, 5)
    mean, variance, _ = exact(measured)
    with pytest.raises(AssertionError):
        agrees(found, np.concatenate([mean[5], variance[5]]), 400)


@pytest.mark.parametrize(("frame", "seen"), [(0, 4), (3, 7), (T - 3, T), (T - 1, T)])
@pytest.mark.parametrize("ess_threshold", [0.5, 1.0])
def test_fixed_lag_converges_to_the_posterior_given_that_many_frames_more(frame, seen, ess_threshold):
    n = 1000
    found, measured = rows(lambda p, y: FixedLag(p, y, n_particles=n, lag=3, ess_threshold=ess_threshold), 0.0, frame)
    mean, variance, _ = exact(measured[:seen])
    agrees(found, np.concatenate([mean[frame], variance[frame]]), 50)  # few distinct ancestors, counted below


def test_every_frame_is_told_once_in_order_and_ancestors_lead_along_the_paths():
    measured = simulate(T, seed=0)
    for inference in (
        FixedLag(LinearPrior(), Position(measured), n_particles=50, lag=4),
        FixedLag(LinearPrior(), Position(measured), n_particles=50, lag=40, least_ancestors=1),
        FixedLag(LinearPrior(), Position(measured), n_particles=50, lag=4, least_ancestors=20),
        BackwardSimulation(LinearPrior(), Position(measured), n_particles=50, n_paths=20),
    ):
        steps = list(inference.run(frames(T), MEAN0, streams(1)))
        assert [step.frame.index for step in steps] == list(range(T))
        plain = list(
            ParticleFilter(LinearPrior(), Position(measured), n_particles=50).run(frames(T), MEAN0, streams(1))
        )
        for before, step, filtered in zip(steps, steps[1:], plain[1:], strict=False):
            origin = {tuple(x): tuple(plain[step.frame.index - 1].particles[a]) for x, a in
                      zip(filtered.particles, filtered.ancestors, strict=True)}  # fmt: skip
            parents = before.particles[step.ancestors]
            if isinstance(inference, FixedLag):  # a path of the filter's own ancestry
                assert [tuple(x) for x in parents] == [origin[tuple(x)] for x in step.particles]
            assert step.log_evidence == filtered.log_evidence
            assert step.expected_pose == pytest.approx(np.exp(step.log_weights) @ step.poses)


def test_one_move_accepts_every_proposal_where_the_previous_pose_does_not_matter():
    measured = simulate(T, seed=0)
    for h, accepted in ((0.0, True), (-0.9, False)):
        options = {"n_particles": 60, "n_paths": 40, "moves": 1, "least_ancestors": 1}
        inference = BackwardSimulation(LinearPrior(), Position(measured, h=h), **options)
        steps = list(inference.run(frames(T), MEAN0, streams(1)))
        assert all(step.diagnostics["acceptance"] == 1.0 for step in steps[:-1]) == accepted


def test_paths_are_rejuvenated():
    """Ancestry alone leaves a handful of distinct first states; backward simulation does not."""
    measured = simulate(60, seed=0)
    distinct = []
    for inference in (
        FixedLag(LinearPrior(), Position(measured), n_particles=100, lag=100, least_ancestors=1),
        BackwardSimulation(LinearPrior(), Position(measured), n_particles=100, n_paths=100, least_ancestors=1),
    ):
        distinct.append(next(iter(inference.run(frames(60), MEAN0, streams(1)))).diagnostics["distinct"])
    assert distinct[0] < 10 < 30 < distinct[1]


MAKE = {
    "fixed lag": lambda y, least: FixedLag(LinearPrior(), y, n_particles=200, lag=15, least_ancestors=least),
    "backward simulation": lambda y, least: BackwardSimulation(
        LinearPrior(), y, n_particles=60, n_paths=200, least_ancestors=least
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


@pytest.mark.parametrize("name", MAKE)
def test_bands_of_enough_ancestors_hold_the_truth_as_often_as_they_say(name):
    """Truths from the model itself: a band of n ≥ 20 draws holds it in 0.86 to 0.90 of all cases."""
    n_runs, n_frames, shares = 40, 20, {}
    for least in (1, 20):
        inside = []
        for seed in range(n_runs):
            measured, states = simulate_states(n_frames, seed, sigma=0.05)
            for step in MAKE[name](Position(measured, sigma=0.05), least).run(frames(n_frames), MEAN0, streams(seed)):
                weights = np.exp(step.log_weights)
                inside.append(covered(step.particles, weights, states[step.frame.index], (0.9,)).mean())
        runs = np.array(inside).reshape(n_runs, n_frames).mean(axis=1)
        shares[least] = runs.mean(), runs.std() / np.sqrt(n_runs)
    share, error = shares[20]
    assert 0.86 - 4.0 * error < share < 0.90 + 4.0 * error
    assert shares[1][0] < 0.86 - 4.0 * shares[1][1]  # which ancestry alone does not reach


def test_evaluations_are_counted():
    measured = simulate(T, seed=0)
    for inference in (
        FixedLag(LinearPrior(), (likelihood := Position(measured)), n_particles=50),
        BackwardSimulation(LinearPrior(), (likelihood := Position(measured)), n_particles=50, n_paths=20, moves=3),
    ):
        likelihood = inference.filter.likelihood
        steps = list(inference.run(frames(T), MEAN0, streams(1)))
        assert sum(step.evaluations for step in steps) == likelihood.evaluated > 0


def test_the_same_seed_gives_the_same_steps():
    measured = simulate(T, seed=0)
    for make in (FixedLag, BackwardSimulation):
        runs = [
            list(make(LinearPrior(), Position(measured), n_particles=40).run(frames(T), MEAN0, streams(seed)))
            for seed in (5, 5, 6)
        ]
        for first, second in zip(runs[0], runs[1], strict=True):
            assert (first.particles == second.particles).all()
        assert not all((a.particles == b.particles).all() for a, b in pairwise([runs[0][3], runs[2][3]]))


def test_no_frames_no_steps():
    for make in (FixedLag, BackwardSimulation):
        assert list(make(LinearPrior(), Position([]), n_particles=4).run([], MEAN0, streams(0))) == []


@pytest.mark.parametrize(
    ("make", "option"), [(FixedLag, "lag"), (FixedLag, "least_ancestors"), (BackwardSimulation, "n_paths")]
)
def test_wrong_options_are_named(make, option):
    with pytest.raises(InputError, match=option):
        make(Smooth(), None, **{option: 0})
