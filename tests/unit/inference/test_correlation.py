"""Errors that go on from frame to frame: their correlation is found, and fewer frames count for it."""

import numpy as np
import pytest
from keypoint_scenes import BODY, CAMERA, NOTHING, frames, walk

from workbench.body.kinematics import joints
from workbench.core.observations import observe
from workbench.core.residual import SQUARED, Loss
from workbench.inference.least_squares.single_frame import FitData
from workbench.inference.least_squares.systematic_errors import effective_fraction, error_correlation

SIGMA_PX = 3.0
ROBUST = Loss("geman_mcclure", 1.5)


def estimate(rho, n_frames=60, outliers=0.0, every_s=1 / 14, missed=()):
    times, _, poses = walk(n_frames)
    rng = np.random.default_rng(1)
    noise = rng.standard_normal((n_frames, 15, 2))
    for t in range(1, n_frames):
        noise[t] = rho * noise[t - 1] + np.sqrt(1.0 - rho**2) * noise[t]
    noise[rng.random(noise.shape[:2]) < outliers] = 30.0
    pixels = CAMERA.project(joints(BODY.skeleton, poses)) + SIGMA_PX * noise
    marks = np.concatenate([pixels, np.ones((n_frames, 15, 1))], axis=2)
    marks[list(missed)] = NOTHING
    seen, _ = observe(frames(times, marks), BODY.skeleton, 10, rng)
    return error_correlation(BODY.skeleton, seen, every_s * np.arange(n_frames), poses, SIGMA_PX)


@pytest.mark.parametrize("rho", [0.3, 0.6, 0.9])
def test_the_correlation_is_found(rho):
    n = 15 * 2 * 59
    # Bartlett: the estimate's variance is (1 − ρ²) / n
    assert estimate(rho) == pytest.approx(rho, abs=5.0 * np.sqrt((1.0 - rho**2) / n))


def test_joints_taken_for_others_do_not_decide():
    assert estimate(0.6, outliers=0.1) == pytest.approx(0.6, abs=0.1)


def test_independent_errors_few_of_them_and_frames_far_apart_count_as_independent():
    assert estimate(0.0) == 0.0
    assert estimate(0.9, n_frames=4) == 0.0
    assert estimate(0.9, every_s=0.2) == 0.0
    assert estimate(0.9, missed=range(1, 60, 2)) == 0.0


def test_the_share_is_that_of_a_mean():
    """Var of the mean of n numbers of an autoregression is Σ_st ρ^|s − t| / n², of m independent ones 1 / m."""
    n, rho = 1000, 0.7
    lags = np.abs(np.subtract.outer(np.arange(n), np.arange(n)))
    assert effective_fraction(rho) == pytest.approx(n / (rho**lags).sum(), rel=1e-2)
    assert effective_fraction(0.0) == 1.0


@pytest.mark.parametrize("loss", [SQUARED, ROBUST])
def test_a_share_of_the_residuals_is_that_share_of_the_cost(loss):
    misses, slopes = np.array([0.1, -2.0, 5.0]), np.arange(6.0).reshape(3, 2)
    whole = FitData([lambda pose: (misses, slopes)], np.zeros(1), loss)
    part = whole.downweighted(0.2)
    (few, flat), (cost, weights) = part.residuals[0](np.zeros(2)), loss(misses)
    part_cost, part_weights = part.loss(few)
    np.testing.assert_allclose(part_cost, 0.2 * cost)
    np.testing.assert_allclose(flat.T @ (part_weights * few), 0.2 * slopes.T @ (weights * misses))
