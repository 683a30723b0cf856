"""The mixture prior over postures against SciPy's densities, and closed forms."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.stats import multivariate_normal

from workbench.core.pose_prior import PosePrior


def covariance(rng, d, scale=1.0):
    root = rng.standard_normal((d, d))
    return scale * (root @ root.T / d + 0.2 * np.eye(d))


def random_prior(rng, n_components=3, a=4):
    weights = rng.dirichlet(np.full(n_components, 5.0))
    return PosePrior(
        weights,
        rng.standard_normal((n_components, a)),
        np.array([covariance(rng, a, 0.3) for _ in range(n_components)]),
    )


def log_density(prior, x):
    components = zip(prior.weights, prior.means, prior.covariances, strict=True)
    return np.log(sum(weight * multivariate_normal(mean, cov).pdf(x) for weight, mean, cov in components))


def test_components_sum_to_the_density_of_scipy():
    rng = np.random.default_rng(0)
    prior, x = random_prior(rng), rng.standard_normal((7, 4))
    assert np.allclose(np.logaddexp.reduce(prior.log_components(x), axis=1), log_density(prior, x))
    assert np.allclose(prior.responsibilities(x).sum(axis=1), 1.0)


@given(st.integers(0, 10_000), st.floats(0.01, 1.0))
def test_the_geometric_mean_of_one_component_is_its_power(seed, power):
    rng = np.random.default_rng(seed)
    prior = random_prior(rng, n_components=1)
    mean, precision = prior.geometric_mean(rng.standard_normal(4), covariance(rng, 4), power)
    assert np.allclose(mean, prior.means[0], atol=1e-6)
    assert np.allclose(precision, power * np.linalg.inv(prior.covariances[0]))


@given(st.integers(0, 10_000))
def test_expected_responsibilities_are_proportional_to_the_evidence(seed):
    rng = np.random.default_rng(seed)
    prior, mean, cov = random_prior(rng), rng.standard_normal(4), covariance(rng, 4)
    components = zip(prior.weights, prior.means, prior.covariances, strict=True)
    evidence = np.array(
        [
            weight * multivariate_normal(component_mean, component_cov + cov).pdf(mean)
            for weight, component_mean, component_cov in components
        ]
    )
    assert np.allclose(prior.expected_responsibilities(mean, cov), evidence / evidence.sum())


@pytest.mark.parametrize("seed", range(5))
def test_the_log_density_of_the_geometric_mean_is_the_weighted_sum_of_log_densities(seed):
    rng = np.random.default_rng(seed)
    prior, mean, cov = random_prior(rng), rng.standard_normal(4), covariance(rng, 4, 0.05)
    responsibilities = prior.expected_responsibilities(mean, cov)
    pooled_mean, pooled_precision = prior.geometric_mean(mean, cov, 0.5)
    postures = rng.standard_normal((9, 4))
    components = zip(prior.means, prior.covariances, strict=True)
    log_densities = [multivariate_normal(*component).logpdf(postures) for component in components]
    pooled = multivariate_normal(pooled_mean, np.linalg.inv(pooled_precision)).logpdf(postures)
    assert np.ptp(pooled - 0.5 * responsibilities @ log_densities) < 1e-8


def test_responsibilities_of_a_very_uncertain_posture_are_the_weights():
    prior = random_prior(np.random.default_rng(2))
    uncertain = prior.expected_responsibilities(prior.means[0], 1e8 * np.eye(4))
    assert np.allclose(uncertain, prior.weights, atol=1e-6)
    assert prior.expected_responsibilities(prior.means[0], 1e-8 * np.eye(4))[0] > prior.weights[0]
