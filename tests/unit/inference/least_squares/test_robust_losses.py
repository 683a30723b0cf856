"""The robust losses against their closed forms."""

import numpy as np
import pytest

from workbench.core.losses import LOSSES, Loss

Z = np.array([-10.0, -1.0, -0.5, 0.0, 1e-3, 0.5, 1.0, 3.0])


def test_squared():
    rho, weights = Loss("squared", 1.0)(Z)
    np.testing.assert_array_equal(rho, Z**2 / 2.0)
    np.testing.assert_array_equal(weights, 1.0)


def test_huber():
    rho, weights = Loss("huber", 1.0)(Z)
    np.testing.assert_allclose(rho, [9.5, 0.5, 0.125, 0.0, 5e-7, 0.125, 0.5, 2.5])
    np.testing.assert_allclose(weights, [0.1, 1, 1, 1, 1, 1, 1, 1 / 3])


def test_geman_mcclure():
    rho, weights = Loss("geman_mcclure", 1.0)(Z)
    np.testing.assert_allclose(rho, [50 / 101, 0.25, 0.1, 0.0, 5e-7 / (1 + 1e-6), 0.1, 0.25, 0.45])
    np.testing.assert_allclose(weights, [1 / 101**2, 0.25, 0.64, 1.0, (1 + 1e-6) ** -2, 0.64, 0.25, 0.01])
    rho, _ = Loss("geman_mcclure", 1.0)(np.array([1e8]))
    assert rho[0] == pytest.approx(0.5)  # the bound of the cost


@pytest.mark.parametrize("name", LOSSES)
def test_the_weight_is_the_derivative_over_the_residual(name):
    loss, residuals = Loss(name, 1.3), np.random.default_rng(0).normal(0.0, 3.0, (100, 2))
    derivative = (loss(residuals + 1e-6)[0] - loss(residuals - 1e-6)[0]) / 2e-6
    np.testing.assert_allclose(loss(residuals)[1] * residuals, derivative, atol=1e-8)
