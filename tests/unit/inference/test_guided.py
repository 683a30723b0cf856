"""The hybrid's proposal: weighted, its draws stand for the prior; unweighted, they lie where the fit ended."""

import numpy as np
import pytest

from workbench.inference.smc.hybrid import proposal_priors
from workbench.motion.models.training import activity_model
from workbench.priors.activity import Activity

DT = 1 / 14
N = 200_000


@pytest.fixture(scope="module")
def prior(cache):
    return Activity(activity_model(cache=str(cache), n_components=2))


def proposal(prior, share, shift=0.5):
    """One state N times, and a fit `shift` deviations of the prior away from where the prior expects it."""
    rng = np.random.default_rng(0)
    state = np.repeat(rng.standard_normal((1, len(prior.space))), N, axis=0)
    state[:, prior.space.slices["phase"]] = 0.97  # near the end of the cycle, so that draws fall on both sides of it
    predicted, sigma = prior.predicted(state[:1], DT)
    fit = predicted[0] + shift * sigma
    fit[prior.driven.index(prior.space.slices["phase"].start)] += 3.0  # cycles counted on are the same phase
    fits, spreads = np.stack([fit, fit]), np.stack([np.diag((2.0 * sigma) ** 2)] * 2)
    _, guided = proposal_priors(prior, fits, spreads, np.array([0.0, DT]), share)
    moved, log_weights = guided.propose(state, DT, np.random.default_rng(1))
    return predicted[0], sigma, moved, np.exp(log_weights)


def unwrapped(prior, moved, predicted):
    turn = prior.driven.index(prior.space.slices["phase"].start)
    columns = moved[:, prior.driven].copy()
    columns[:, turn] += np.round(predicted[turn] - columns[:, turn])
    return columns


@pytest.mark.parametrize("share", [0.0, 0.5, 0.9])
def test_weighted_draws_have_the_priors_moments(prior, share):
    predicted, sigma, moved, weights = proposal(prior, share)
    columns = (unwrapped(prior, moved, predicted) - predicted) / sigma
    error = weights.std() / np.sqrt(N)
    assert weights.mean() == pytest.approx(1.0, abs=5 * error + 1e-12)  # E_q[p / q] = 1
    for power, expected in ((1, 0.0), (2, 1.0)):
        values = weights[:, None] * columns**power
        standard_errors = values.std(axis=0) / np.sqrt(N)
        assert (np.abs(values.mean(axis=0) - expected) < 5 * standard_errors).all()


def test_unweighted_draws_are_the_product_of_fit_and_prior(prior):
    """Of N(0, 1) and N(m, 2²), in the prior's deviations: mean m / 5, variance 4 / 5."""
    predicted, sigma, moved, _ = proposal(prior, share=0.999_999, shift=2.0)
    columns = (unwrapped(prior, moved, predicted) - predicted) / sigma
    assert columns.mean(axis=0) == pytest.approx(2.0 / 5.0, abs=5 / np.sqrt(N))
    assert columns.var(axis=0) == pytest.approx(4.0 / 5.0, abs=5 * np.sqrt(2 / N))
