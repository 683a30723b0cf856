"""Autocorrelation of keypoint errors: its estimate, and the effective fraction of the residuals."""

import numpy as np
import pytest
from keypoint_scenes import BODY, CAMERA, NOTHING, frames, walk

from workbench.body.kinematics import joints
from workbench.core.losses import SQUARED, Loss
from workbench.core.observations import observe
from workbench.inference.least_squares.solver.single_frame import FitData
from workbench.inference.least_squares.video.systematic_errors import effective_fraction, error_correlation

SIGMA_PX = 3.0
ROBUST = Loss("geman_mcclure", 1.5)


def estimate(rho, n_frames=60, outliers=0.0, interval_s=1 / 14, missing=()):
    """Return the correlation estimated from the keypoints of a walk, whose errors are an autoregression."""
    times, _, poses = walk(n_frames)
    rng = np.random.default_rng(1)
    noise = rng.standard_normal((n_frames, 15, 2))
    for t in range(1, n_frames):
        noise[t] = rho * noise[t - 1] + np.sqrt(1.0 - rho**2) * noise[t]
    noise[rng.random(noise.shape[:2]) < outliers] = 30.0
    pixels = CAMERA.project(joints(BODY.skeleton, poses)) + SIGMA_PX * noise
    keypoints = np.concatenate([pixels, np.ones((n_frames, 15, 1))], axis=2)
    keypoints[list(missing)] = NOTHING
    observations, _ = observe(frames(times, keypoints), BODY.skeleton, 10, rng)
    return error_correlation(BODY.skeleton, observations, interval_s * np.arange(n_frames), poses, SIGMA_PX)


@pytest.mark.parametrize("rho", [0.3, 0.6, 0.9])
def test_the_correlation_is_estimated(rho):
    n = 15 * 2 * 59
    # Bartlett: the variance of the estimate is (1 − ρ²) / n
    assert estimate(rho) == pytest.approx(rho, abs=5.0 * np.sqrt((1.0 - rho**2) / n))


def test_outliers_do_not_change_the_correlation():
    assert estimate(0.6, outliers=0.1) == pytest.approx(0.6, abs=0.1)


@pytest.mark.parametrize(
    "options",
    [
        {"rho": 0.0},
        {"rho": 0.9, "n_frames": 4},
        {"rho": 0.9, "interval_s": 0.2},
        {"rho": 0.9, "missing": range(1, 60, 2)},
    ],
    ids=["independent", "few frames", "long intervals", "every second frame"],
)
def test_an_undetermined_correlation_is_zero(options):
    assert estimate(**options) == 0.0


def test_the_effective_fraction_is_that_of_the_variance_of_a_mean():
    """The mean of n numbers of an autoregression has variance Σ_st ρ^|s − t| / n², that of m independent ones 1 / m."""
    n, rho = 1000, 0.7
    lags = np.abs(np.subtract.outer(np.arange(n), np.arange(n)))
    assert effective_fraction(rho) == pytest.approx(n / (rho**lags).sum(), rel=1e-2)
    assert effective_fraction(0.0) == 1.0


@pytest.mark.parametrize("loss", [SQUARED, ROBUST])
def test_downweighted_residuals_scale_cost_and_gradient(loss):
    residuals, jacobian = np.array([0.1, -2.0, 5.0]), np.arange(6.0).reshape(3, 2)
    data = FitData([lambda pose: (residuals, jacobian)], np.zeros(1), loss).downweighted(0.2)
    (scaled_residuals, scaled_jacobian), (cost, weights) = data.residuals[0](np.zeros(2)), loss(residuals)
    scaled_cost, scaled_weights = data.loss(scaled_residuals)
    np.testing.assert_allclose(scaled_cost, 0.2 * cost)
    gradient = scaled_jacobian.T @ (scaled_weights * scaled_residuals)
    np.testing.assert_allclose(gradient, 0.2 * jacobian.T @ (weights * residuals))
