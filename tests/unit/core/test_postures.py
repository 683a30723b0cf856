"""The density of postures: heights as scipy's, products with Gaussians in closed form and by a climb."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.optimize import minimize
from scipy.stats import multivariate_normal

from workbench.core.pose_prior import PosePrior


def covariance(rng, d, scale=1.0):
    mixed = rng.standard_normal((d, d))
    return scale * (mixed @ mixed.T / d + 0.2 * np.eye(d))


def made(rng, n_parts=3, a=4):
    weights = rng.dirichlet(np.full(n_parts, 5.0))
    return PosePrior(
        weights, rng.standard_normal((n_parts, a)), np.array([covariance(rng, a, 0.3) for _ in range(n_parts)])
    )


def log_density(postures, x):
    parts = zip(postures.weights, postures.means, postures.covariances, strict=True)
    return np.log(sum(weight * multivariate_normal(mean, cov).pdf(x) for weight, mean, cov in parts))


def test_heights_of_parts_sum_to_scipys_density():
    rng = np.random.default_rng(0)
    postures, x = made(rng), rng.standard_normal((7, 4))
    assert np.allclose(np.logaddexp.reduce(postures.log_components(x), axis=1), log_density(postures, x))
    assert np.allclose(postures.responsibilities(x).sum(axis=1), 1.0)


@given(st.integers(0, 10_000), st.floats(0.0, 1.0))
def test_one_parts_product_is_that_of_two_gaussians(seed, power):
    rng = np.random.default_rng(seed)
    postures, mean, cov = made(rng, n_parts=1), rng.standard_normal(6), covariance(rng, 6)
    chosen = np.eye(6)[2:]  # the last four
    precision = np.linalg.inv(cov) + power * chosen.T @ np.linalg.inv(postures.covariances[0]) @ chosen
    pull = np.linalg.solve(cov, mean) + power * chosen.T @ np.linalg.solve(postures.covariances[0], postures.means[0])
    pose, narrowed = postures.geometric_product(mean, cov, power)
    assert np.allclose(pose, np.linalg.solve(precision, pull), atol=1e-6)
    assert np.allclose(narrowed, np.linalg.inv(precision), atol=1e-6)


@given(st.integers(0, 10_000), st.floats(0.01, 1.0))
def test_a_belief_times_the_nearest_gaussian_is_what_is_drawn(seed, power):
    rng = np.random.default_rng(seed)
    postures, mean, cov = made(rng), rng.standard_normal(6), covariance(rng, 6)
    near, precision = postures.geometric_mean(mean[2:], cov[2:, 2:], power)
    both = np.linalg.inv(cov)
    pull = both @ mean
    both[2:, 2:] += precision
    pull[2:] += precision @ near
    pose, narrowed = postures.geometric_product(mean, cov, power)
    assert np.allclose(pose, np.linalg.solve(both, pull), atol=1e-6)
    assert np.allclose(narrowed, np.linalg.inv(both), atol=1e-6)


@given(st.integers(0, 10_000))
def test_what_is_believed_is_of_a_part_as_its_evidence_says(seed):
    rng = np.random.default_rng(seed)
    postures, mean, cov = made(rng), rng.standard_normal(4), covariance(rng, 4)
    parts = zip(postures.weights, postures.means, postures.covariances, strict=True)
    evidence = np.array([weight * multivariate_normal(middle, own + cov).pdf(mean) for weight, middle, own in parts])
    assert np.allclose(postures.expected_responsibilities(mean, cov), evidence / evidence.sum())


@pytest.mark.parametrize("seed", range(5))
def test_of_several_parts_it_is_their_mean_one_by_how_likely_each_is(seed):
    rng = np.random.default_rng(seed)
    postures, mean, cov = made(rng), rng.standard_normal(6), covariance(rng, 6, 0.05)
    shares = postures.expected_responsibilities(mean[2:], cov[2:, 2:])

    def depth(pose):
        parts = zip(postures.means, postures.covariances, strict=True)
        heights = np.array([multivariate_normal(middle, own).logpdf(pose[2:]) for middle, own in parts])
        return -0.5 * shares @ heights - multivariate_normal(mean, cov).logpdf(pose)

    pose, narrowed = postures.geometric_product(mean, cov, 0.5)
    found = minimize(depth, pose + 0.1, tol=1e-12)
    assert np.abs(found.x - pose).max() < 1e-4
    assert np.linalg.eigvalsh((cov - narrowed)[2:, 2:]).min() > 0.0  # postures are believed more surely


def test_who_is_sure_of_nothing_may_be_of_any_part():
    postures = made(np.random.default_rng(2))
    assert np.allclose(
        postures.expected_responsibilities(postures.means[0], 1e8 * np.eye(4)), postures.weights, atol=1e-6
    )
    assert postures.expected_responsibilities(postures.means[0], 1e-8 * np.eye(4))[0] > postures.weights[0]
