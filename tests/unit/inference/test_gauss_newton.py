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
    last_moments,
    simulate,
    streams,
)

from workbench.inference.smc.bootstrap import Bootstrap
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


def about_the_peak(prior, likelihood):
    return ParticleFilter(prior, likelihood, algorithm=GaussNewton(), n_particles=N)


def test_a_likelihood_that_is_not_quadratic_is_weighted_right():
    """Against a plain filter with fifty times as many particles, whose own error is a seventh."""
    squared = Squared(simulate(T, seed=3), sigma=0.1)
    plain = last_moments(lambda p, y: ParticleFilter(p, y, n_particles=50 * N), squared, T, range(6))
    assert_agree(last_moments(about_the_peak, squared, T, range(SEEDS)), plain.mean(axis=0))


def test_a_sharp_likelihood_leaves_the_exact_posterior_and_evidence():
    measured = simulate(T, seed=3, sigma=0.01)
    mean, variance, evidence = exact(measured, sigma=0.01)
    found = last_moments(about_the_peak, Position(measured, sigma=0.01), T, range(SEEDS))
    assert_agree(found, [*mean[-1], *variance[-1], evidence])


def mean_size(measured, move):
    """Mean effective sample size over the frames of two runs, as a part of the particles."""
    inference = ParticleFilter(LinearPrior(), Position(measured, sigma=0.005), algorithm=move, n_particles=1000)
    steps = [step for seed in range(2) for step in list(inference.run(frames(T), MEAN0, streams(seed)))[1:]]
    return np.mean([step.ess / 1000 for step in steps])


@pytest.mark.parametrize(("weight", "fraction"), [(1.0, 0.8), (0.0, 0.5)])
def test_the_weights_are_even_where_the_quadratic_is_the_likelihood(weight, fraction):
    """Of the share that is drawn by it, in the limit; without the quadratic it is the plain filter's."""
    measured = simulate(T, seed=3, sigma=0.005)
    size, plain = (
        mean_size(measured, GaussNewton(curvature_weight=weight, proposal_fraction=fraction)),
        mean_size(measured, Bootstrap()),
    )
    if weight:
        assert size > 0.75 > 4.0 * plain  # nearly `share`, but for those of the others that count too
    else:
        assert size == pytest.approx(plain, rel=0.2)


def test_velocities_cost_nothing_and_evaluations_are_counted():
    likelihood = Position(np.zeros(4))
    inference = ParticleFilter(Seen(), likelihood, algorithm=GaussNewton(n_newton_steps=3), n_particles=50)
    steps = list(inference.run(frames(4), MEAN0, streams(0)))
    assert [step.evaluations for step in steps] == [0.0, *[50 + 3 * (1 + 2 * 1)] * 3]
    assert sum(step.evaluations for step in steps) == likelihood.evaluated
