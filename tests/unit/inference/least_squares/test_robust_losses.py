"""The robust losses against their closed forms."""

import numpy as np
import pytest

from workbench.core.losses import LOSSES
from workbench.core.residual import geman_mcclure, huber, squared

Z = np.array([-10.0, -1.0, -0.5, 0.0, 1e-3, 0.5, 1.0, 3.0])


def test_squared():
    rho, weights = squared(Z)
    np.testing.assert_array_equal(rho, Z**2 / 2.0)
    np.testing.assert_array_equal(weights, 1.0)


def test_huber():
    rho, weights = huber(Z)
    np.testing.assert_allclose(rho, [9.5, 0.5, 0.125, 0.0, 5e-7, 0.125, 0.5, 2.5])
    np.testing.assert_allclose(weights, [0.1, 1, 1, 1, 1, 1, 1, 1 / 3])


def test_geman_mcclure():
    rho, weights = geman_mcclure(Z)
    np.testing.assert_allclose(rho, [50 / 101, 0.25, 0.1, 0.0, 5e-7 / (1 + 1e-6), 0.1, 0.25, 0.45])
    np.testing.assert_allclose(weights, [1 / 101**2, 0.25, 0.64, 1.0, (1 + 1e-6) ** -2, 0.64, 0.25, 0.01])
    rho, _ = geman_mcclure(np.array([1e8]))
    assert rho[0] == pytest.approx(0.5)  # the bound of the cost


@pytest.mark.parametrize("loss", LOSSES.values(), ids=LOSSES.keys())
def test_the_weight_is_the_derivative_over_the_residual(loss):
    z = np.random.default_rng(0).normal(0.0, 3.0, 200)
    derivative = (loss(z + 1e-6)[0] - loss(z - 1e-6)[0]) / 2e-6
    np.testing.assert_allclose(loss(z)[1] * z, derivative, atol=1e-8)
