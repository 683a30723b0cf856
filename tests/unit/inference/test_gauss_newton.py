"""Draws about the peak against the exact posterior and evidence of a linear Gaussian model."""

import numpy as np
import pytest
from linear_gaussian import (
    MEAN0,
    LinearPrior,
    Position,
    assert_agree,
    exact,
    frames,
    moments,
    simulate,
    streams,
)

from workbench.inference.smc.gauss_newton import GaussNewton
from workbench.inference.smc.particle_filter import ParticleFilter

T, SEEDS, N = 8, 25, 400


class Seen(LinearPrior):
    """The pose shows the position only."""

    def pose(self, state):
        return state * [1.0, 0.0]


class Squared(Position):
    """The measurement is of the position's square, whose logarithm is not quadratic."""

    def log_prob(self, previous, frame, previous_pose, pose):
        return super().log_prob(previous, frame, previous_pose, pose * np.abs(pose))


def runs(make, likelihood, n_seeds=SEEDS):
    found, sizes = [], []
    for seed in range(n_seeds):
        steps = list(make(LinearPrior(), likelihood()).run(frames(T), MEAN0, streams(seed)))
        found.append([*np.concatenate(moments(steps[-1])), steps[-1].log_evidence])
        sizes += [step.ess / len(step.particles) for step in steps[1:]]
    return np.array(found), float(np.mean(sizes))


@pytest.mark.parametrize(("sigma", "h"), [(0.3, 0.0), (0.01, 0.0), (0.1, -0.9)])
def test_converges_to_the_exact_posterior_and_evidence(sigma, h):
    """With h the quadratic is that of another parent."""
    measured = simulate(T, seed=3, sigma=sigma, h=h)
    mean, variance, evidence = exact(measured, sigma=sigma, h=h)
    found, _ = runs(
        lambda p, y: ParticleFilter(p, y, move=GaussNewton(), n_particles=N),
        lambda: Position(measured, sigma=sigma, h=h),
    )
    assert_agree(found, [*mean[-1], *variance[-1], evidence])


def test_a_likelihood_that_is_not_quadratic_is_weighted_right():
    """Against a plain filter with fifty times as many particles, whose own error is a seventh."""
    measured = simulate(T, seed=3)
    found, _ = runs(
        lambda p, y: ParticleFilter(p, y, move=GaussNewton(), n_particles=N), lambda: Squared(measured, sigma=0.1)
    )
    plain, _ = runs(lambda p, y: ParticleFilter(p, y, n_particles=50 * N), lambda: Squared(measured, sigma=0.1), 6)
    assert_agree(found, plain.mean(axis=0))


@pytest.mark.parametrize(("flatten", "share"), [(1.0, 0.8), (0.0, 0.5)])
def test_the_weights_are_even_where_the_quadratic_is_the_likelihood(flatten, share):
    """Of the share that is drawn by it, in the limit; without the quadratic it is the plain filter's."""
    measured = simulate(T, seed=3, sigma=0.005)
    move = GaussNewton(flatten=flatten, share=share)
    make = lambda p, y: ParticleFilter(p, y, move=move, n_particles=1000)  # noqa: E731
    _, size = runs(make, lambda: Position(measured, sigma=0.005), n_seeds=2)
    _, plain = runs(lambda p, y: ParticleFilter(p, y, n_particles=1000), lambda: Position(measured, sigma=0.005), 2)
    if flatten:
        assert size > 0.75 > 4.0 * plain  # nearly `share`, but for those of the others that count too
    else:
        assert size == pytest.approx(plain, rel=0.2)


def test_velocities_cost_nothing_and_evaluations_are_counted():
    likelihood = Position(np.zeros(4))
    inference = ParticleFilter(Seen(), likelihood, move=GaussNewton(steps=3), n_particles=50)
    steps = list(inference.run(frames(4), MEAN0, streams(0)))
    assert [step.evaluations for step in steps] == [0.0, *[50 + 3 * (1 + 2 * 1)] * 3]
    assert sum(step.evaluations for step in steps) == likelihood.evaluated
