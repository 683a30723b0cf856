"""The hybrid's proposal: weighted samples have the moments of the prior, unweighted ones those of fit times prior."""

import numpy as np
import pytest

from workbench.inference.smc.hybrid import proposal_priors
from workbench.motion.models.training import activity_model
from workbench.priors.activity import Activity

DT = 1 / 14
N = 50_000


@pytest.fixture(scope="module")
def prior(cache):
    return Activity(activity_model(cache=str(cache), n_components=2))


def proposal(prior, fraction, shift=0.5):
    """Return N proposed changes (N, D) of one state, in deviations of the prior, and their weights (N,).

    fraction: of the samples that are drawn by the fit. shift: of the fit from the prior's mean, in its deviations; the
    deviation of the fit is 2.
    """
    rng = np.random.default_rng(0)
    state = np.repeat(rng.standard_normal((1, len(prior.space))), N, axis=0)
    state[:, prior.space.slices["phase"]] = 0.97  # near the end of the cycle, so that samples lie on both sides of it
    predicted, sigma = prior.predicted(state[:1], DT)
    phase = prior.driven.index(prior.space.slices["phase"].start)
    fit = predicted[0] + shift * sigma
    fit[phase] += 3.0  # whole cycles do not change the phase
    fits, covariances = np.stack([fit, fit]), np.stack([np.diag((2.0 * sigma) ** 2)] * 2)
    _, guided = proposal_priors(prior, fits, covariances, np.array([0.0, DT]), fraction)
    samples, log_weights = guided.propose(state, DT, np.random.default_rng(1))
    changes = samples[:, prior.driven] - predicted[0]
    changes[:, phase] -= np.round(changes[:, phase])
    return changes / sigma, np.exp(log_weights)


@pytest.mark.parametrize("fraction", [0.0, 0.5, 0.9])
def test_weighted_samples_have_the_moments_of_the_prior(prior, fraction):
    changes, weights = proposal(prior, fraction)
    error = weights.std() / np.sqrt(N)
    assert weights.mean() == pytest.approx(1.0, abs=5 * error + 1e-12)  # E_q[p / q] = 1
    for power, expected in ((1, 0.0), (2, 1.0)):
        values = weights[:, None] * changes**power
        standard_errors = values.std(axis=0) / np.sqrt(N)
        assert (np.abs(values.mean(axis=0) - expected) < 5 * standard_errors).all()


def test_unweighted_samples_have_the_moments_of_fit_times_prior(prior):
    """The product of N(0, 1) and N(m, 2²) has mean m / 5 and variance 4 / 5."""
    changes, _ = proposal(prior, fraction=0.999_999, shift=2.0)
    assert changes.mean(axis=0) == pytest.approx(2.0 / 5.0, abs=5 / np.sqrt(N))
    assert changes.var(axis=0) == pytest.approx(4.0 / 5.0, abs=5 * np.sqrt(2 / N))
