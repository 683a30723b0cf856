"""The Gauss–Newton proposal: posterior, weights and evaluations."""

import numpy as np
import pytest
from linear_gaussian import (
    MEAN0,
    LinearPrior,
    Position,
    assert_agree,
    frames,
    last_moments,
    simulate,
    streams,
)

from workbench.inference.smc.bootstrap import Bootstrap
from workbench.inference.smc.gauss_newton import GaussNewton
from workbench.inference.smc.particle_filter import ParticleFilter

T, SEEDS, N = 8, 25, 400


class PositionPose(LinearPrior):
    """The linear model whose pose is the position only."""

    def pose(self, state):
        return state * [1.0, 0.0]


class Squared(Position):
    """A measurement of the signed square of the position, whose log likelihood is not quadratic."""

    def log_prob(self, previous, frame, previous_pose, pose):
        return super().log_prob(previous, frame, previous_pose, pose * np.abs(pose))


def gauss_newton(prior, likelihood):
    return ParticleFilter(prior, likelihood, algorithm=GaussNewton(), n_particles=N)


def test_the_posterior_is_exact_for_a_likelihood_that_is_not_quadratic():
    """The reference is a bootstrap filter with fifty times as many particles, whose error is a seventh."""
    squared = Squared(simulate(T, seed=3), sigma=0.1)
    reference = last_moments(lambda p, y: ParticleFilter(p, y, n_particles=50 * N), squared, T, range(6))
    assert_agree(last_moments(gauss_newton, squared, T, range(SEEDS)), reference.mean(axis=0))


def mean_ess(algorithm):
    """Return the mean effective sample size over the frames of two runs, as a fraction of the particles."""
    likelihood = Position(simulate(T, seed=3, sigma=0.005), sigma=0.005)
    inference = ParticleFilter(LinearPrior(), likelihood, algorithm=algorithm, n_particles=1000)
    steps = [step for seed in range(2) for step in list(inference.run(frames(T), MEAN0, streams(seed)))[1:]]
    return np.mean([step.ess / 1000 for step in steps])


def test_proposals_by_an_exact_quadratic_have_uniform_weights():
    """The effective fraction is near the proposal fraction; the other particles are those of the bootstrap filter."""
    assert mean_ess(GaussNewton(curvature_weight=1.0, proposal_fraction=0.8)) > 0.75 > 4.0 * mean_ess(Bootstrap())


def test_without_the_quadratic_the_weights_are_those_of_the_bootstrap_filter():
    algorithm = GaussNewton(curvature_weight=0.0, proposal_fraction=0.5)
    assert mean_ess(algorithm) == pytest.approx(mean_ess(Bootstrap()), rel=0.2)


def test_only_directions_of_the_pose_are_evaluated():
    likelihood = Position(np.zeros(4))
    inference = ParticleFilter(PositionPose(), likelihood, algorithm=GaussNewton(n_newton_steps=3), n_particles=50)
    steps = list(inference.run(frames(4), MEAN0, streams(0)))
    assert [step.evaluations for step in steps] == [0.0, *[50 + 3 * (1 + 2 * 1)] * 3]
    assert sum(step.evaluations for step in steps) == likelihood.evaluated
