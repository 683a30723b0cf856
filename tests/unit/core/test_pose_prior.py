"""The mixture prior over postures against SciPy's densities, closed forms and numerical minimization."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.optimize import minimize
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


@given(st.integers(0, 10_000), st.floats(0.0, 1.0))
def test_the_product_with_one_component_is_that_of_two_gaussians(seed, power):
    rng = np.random.default_rng(seed)
    prior, mean, cov = random_prior(rng, n_components=1), rng.standard_normal(6), covariance(rng, 6)
    selection = np.eye(6)[2:]  # the posture: the last four parameters
    precision = np.linalg.inv(cov) + power * selection.T @ np.linalg.inv(prior.covariances[0]) @ selection
    information = np.linalg.solve(cov, mean) + power * selection.T @ np.linalg.solve(
        prior.covariances[0], prior.means[0]
    )
    product_mean, product_covariance = prior.geometric_product(mean, cov, power)
    assert np.allclose(product_mean, np.linalg.solve(precision, information), atol=1e-6)
    assert np.allclose(product_covariance, np.linalg.inv(precision), atol=1e-6)


@given(st.integers(0, 10_000), st.floats(0.01, 1.0))
def test_the_product_is_that_with_the_geometric_mean_as_a_gaussian(seed, power):
    rng = np.random.default_rng(seed)
    prior, mean, cov = random_prior(rng), rng.standard_normal(6), covariance(rng, 6)
    pooled_mean, pooled_precision = prior.geometric_mean(mean[2:], cov[2:, 2:], power)
    total_precision = np.linalg.inv(cov)
    information = total_precision @ mean
    total_precision[2:, 2:] += pooled_precision
    information[2:] += pooled_precision @ pooled_mean
    product_mean, product_covariance = prior.geometric_product(mean, cov, power)
    assert np.allclose(product_mean, np.linalg.solve(total_precision, information), atol=1e-6)
    assert np.allclose(product_covariance, np.linalg.inv(total_precision), atol=1e-6)


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
def test_the_product_mean_maximizes_the_weighted_sum_of_log_densities(seed):
    rng = np.random.default_rng(seed)
    prior, mean, cov = random_prior(rng), rng.standard_normal(6), covariance(rng, 6, 0.05)
    responsibilities = prior.expected_responsibilities(mean[2:], cov[2:, 2:])

    def negative_log_product(product_mean):
        components = zip(prior.means, prior.covariances, strict=True)
        log_densities = np.array(
            [
                multivariate_normal(component_mean, component_cov).logpdf(product_mean[2:])
                for component_mean, component_cov in components
            ]
        )
        return -0.5 * responsibilities @ log_densities - multivariate_normal(mean, cov).logpdf(product_mean)

    product_mean, product_covariance = prior.geometric_product(mean, cov, 0.5)
    minimum = minimize(negative_log_product, product_mean + 0.1, tol=1e-12)
    assert np.abs(minimum.x - product_mean).max() < 1e-4
    reduction = (cov - product_covariance)[2:, 2:]
    assert np.linalg.eigvalsh(reduction).min() > 0.0


def test_responsibilities_of_a_very_uncertain_posture_are_the_weights():
    prior = random_prior(np.random.default_rng(2))
    uncertain = prior.expected_responsibilities(prior.means[0], 1e8 * np.eye(4))
    assert np.allclose(uncertain, prior.weights, atol=1e-6)
    assert prior.expected_responsibilities(prior.means[0], 1e-8 * np.eye(4))[0] > prior.weights[0]
