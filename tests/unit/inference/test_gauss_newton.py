"""The Gauss–Newton proposal: quadratic, posterior, weights and evaluations."""

from types import SimpleNamespace

import numpy as np
import pytest
from linear_gaussian import MEAN0, LinearPrior, Position, assert_agree, frames, last_moments, simulate, streams

from workbench.core.state_space import StateSpace
from workbench.inference.smc.bootstrap import Bootstrap
from workbench.inference.smc.gauss_newton import GaussNewton, _fit_quadratic, _PredictedStates
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


def fitted(log_prob, x, pairs, stds=(0.5, 1.0, 2.0)):
    """Return the quadratic of a log likelihood of states (D = 4), whose columns 0, 1 and 3 have noise, at x.

    The pose consists of the columns 0 and 3.
    """
    space, noisy = StateSpace.of({"all": (("a", "b", "c", "d"), "m")}), np.array([0, 1, 3])
    prior = SimpleNamespace(pose=lambda states: states[:, [0, 3]])
    parents = SimpleNamespace(log_weights=np.log([0.2, 0.8]))

    def evaluate(states, indices):
        assert (indices == 1).all()  # the parent of the largest weight
        return SimpleNamespace(log_prob=log_prob(states))

    target = SimpleNamespace(prior=prior, parents=parents, evaluate=evaluate)
    prediction = _PredictedStates(space, np.zeros((2, 4)), np.zeros(4), noisy, np.ones(3), np.diag(np.square(stds)))
    return _fit_quadratic(target, prediction, x, pairs)


@pytest.mark.parametrize("pairs", [False, True])
@pytest.mark.parametrize("correlation", [0.6, -0.6, 1.5])
def test_the_quadratic_of_a_quadratic_is_exact_and_concave(pairs, correlation):
    x, widths = np.array([0.3, -1.0, 2.0, 0.7]), np.array([0.5, 2.0])
    gradient, curvature = np.array([1.5, -0.4]), np.array([[4.0, 0.8 * correlation], [0.8 * correlation, 0.16]])

    def log_prob(states):
        away = (states - x)[:, [0, 3]]
        return 7.0 + away @ gradient - 0.5 * ((away @ curvature) * away).sum(axis=1)

    quadratic = fitted(log_prob, x, pairs)
    np.testing.assert_array_equal(quadratic.x, x)
    np.testing.assert_allclose(quadratic.gradient, [gradient[0], 0.0, gradient[1]], atol=1e-12)
    scales = np.outer(widths, widths)
    values, vectors = np.linalg.eigh(scales * (curvature if pairs else np.diag(np.diag(curvature))))
    expected = np.zeros((3, 3))
    expected[::2, ::2] = vectors @ np.diag(values.clip(min=0.0)) @ vectors.T / scales
    np.testing.assert_allclose(quadratic.curvature, expected, atol=1e-12)


def test_impossible_states_count_as_the_least_likely_possible_one():
    """From 0 at x the log likelihood falls to −1 above in one column, and below it is −∞."""
    quadratic = fitted(lambda states: np.where(states[:, 0] < 0.0, -np.inf, -2.0 * states[:, 0]), np.zeros(4), True)
    np.testing.assert_allclose(quadratic.gradient, 0.0, atol=1e-12)
    np.testing.assert_allclose(quadratic.curvature, np.diag([2.0 / 0.25, 0.0, 0.0]), atol=1e-12)
    nothing = fitted(lambda states: np.full(len(states), -np.inf), np.zeros(4), True)
    assert not nothing.gradient.any()
    assert not nothing.curvature.any()
