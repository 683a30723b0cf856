"""The logarithm of a sum of weights and systematic resampling, against SciPy and NumPy."""

import numpy as np
import pytest
import scipy.special
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from workbench.inference.smc.weights import _inverse_cdf, logsumexp, systematic


@pytest.mark.parametrize("scale", [1e-3, 1.0, 1e4])
def test_logsumexp_equals_that_of_scipy(scale):
    log_weights = scale * np.random.default_rng(0).standard_normal(1000)
    assert logsumexp(log_weights) == pytest.approx(scipy.special.logsumexp(log_weights), rel=1e-13)
    assert logsumexp(np.append(log_weights, -np.inf)) == pytest.approx(logsumexp(log_weights), rel=1e-13)


def test_logsumexp_of_infinite_and_undefined_numbers():
    assert logsumexp(np.full(3, -np.inf)) == -np.inf
    assert np.isnan(logsumexp(np.array([0.0, np.nan])))
    assert logsumexp(np.array([0.0, np.inf])) == np.inf


@settings(max_examples=100, deadline=None)
@given(
    weights=arrays(np.float64, st.integers(1, 30), elements=st.sampled_from([0.0, 0.1, 0.5, 1.0])).filter(np.any),
    n=st.integers(1, 40),
    seed=st.integers(0, 10**6),
)
def test_systematic_parents_are_those_of_the_inverse_distribution_function(weights, n, seed):
    weights = weights / weights.sum()
    positions = (np.arange(n) + np.random.default_rng(seed).random()) / n
    assert (systematic(weights, np.random.default_rng(seed), n) == _inverse_cdf(weights, positions)).all()
