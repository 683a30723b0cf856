"""Prediction and conditioning against conditioning of the joint Gaussian of all states."""

import numpy as np
import pytest

from workbench.core.gaussian import condition, predict

D, K, N_STEPS = 4, 2, 5


def covariance_of(rng, n):
    root = rng.standard_normal((n, n))
    return root @ root.T + 0.1 * np.eye(n)


def marginal_given(mean, covariance, rows, observed, values):
    """Condition a joint Gaussian on the columns `observed` and return the marginal of the columns `rows`."""
    gain = covariance[np.ix_(rows, observed)] @ np.linalg.inv(covariance[np.ix_(observed, observed)])
    return (
        mean[rows] + gain @ (values - mean[observed]),
        covariance[np.ix_(rows, rows)] - gain @ covariance[np.ix_(observed, rows)],
    )


@pytest.fixture
def rng():
    return np.random.default_rng(5)


@pytest.fixture
def model(rng):
    """F, Q, H, R of a linear model, and the first state's mean and covariance."""
    return (
        0.5 * rng.standard_normal((D, D)), covariance_of(rng, D), rng.standard_normal((K, D)), covariance_of(rng, K),
        rng.standard_normal(D), covariance_of(rng, D),
    )  # fmt: skip


def joint(model):
    """Mean and covariance of all states x_1 … x_N and all observations y_1 … y_N, as a linear map of the noises."""
    f, q, h, r, mean, covariance = model
    n = N_STEPS
    states = np.zeros((n * D, n * D))  # of x_1 and the noises of the steps
    for t in range(n):
        for s in range(t + 1):
            states[t * D : (t + 1) * D, s * D : (s + 1) * D] = np.linalg.matrix_power(f, t - s)
    noises = np.kron(np.eye(n), q)
    noises[:D, :D] = covariance
    state_covariance = states @ noises @ states.T
    observe = np.kron(np.eye(n), h)
    states_and_observations = np.concatenate([np.eye(n * D), observe])
    covariance_of_all = states_and_observations @ state_covariance @ states_and_observations.T
    covariance_of_all[n * D :, n * D :] += np.kron(np.eye(n), r)
    return states_and_observations @ states[:, :D] @ mean, covariance_of_all


def filtered_states(model, observations):
    f, q, h, r, mean, covariance = model
    predicted, filtered = [], []
    for t, y in enumerate(observations):
        if t:
            mean, covariance = predict(mean, covariance, f, q)
        predicted.append((mean, covariance))
        mean, covariance = condition(mean, covariance, covariance @ h.T, h @ covariance @ h.T + r, y - h @ mean)
        filtered.append((mean, covariance))
    return predicted, filtered


def test_the_kalman_filter_agrees_with_the_joint_gaussian(model, rng):
    observations = rng.standard_normal((N_STEPS, K))
    mean, covariance = joint(model)
    predicted, filtered = filtered_states(model, observations)
    first_y = N_STEPS * D
    for t in range(N_STEPS):
        rows = np.arange(t * D, (t + 1) * D)
        for results, n_observed in ((predicted, t), (filtered, t + 1)):
            columns = np.arange(first_y, first_y + n_observed * K)
            expected = marginal_given(mean, covariance, rows, columns, observations[:n_observed].ravel())
            np.testing.assert_allclose(results[t][0], expected[0], atol=1e-9)
            np.testing.assert_allclose(results[t][1], expected[1], atol=1e-9)


def test_states_with_one_covariance_are_conditioned_together_as_alone(model, rng):
    f, q, h, r, _, covariance = model
    means, observations = rng.standard_normal((D, 3)), rng.standard_normal((K, 3))
    predicted, predicted_covariance = predict(means, covariance, f, q)
    cross, innovation = predicted_covariance @ h.T, h @ predicted_covariance @ h.T + r
    updated, updated_covariance = condition(
        predicted, predicted_covariance, cross, innovation, observations - h @ predicted
    )
    for k in range(3):
        single = condition(
            predicted[:, k], predicted_covariance, cross, innovation, observations[:, k] - h @ predicted[:, k]
        )
        np.testing.assert_allclose(updated[:, k], single[0], rtol=1e-12)
        np.testing.assert_allclose(updated_covariance, single[1], rtol=1e-12)
