"""The benchmark of the batch fit gives scipy the same problem that we solve."""

import least_squares_scenes as scenes
import numpy as np
import pytest

from analysis.benchmarks.batch import TOLERANCE, Dense, by_scipy
from workbench.core.residual import Loss
from workbench.inference.least_squares.all_frames import fit_motion, fit_problem
from workbench.inference.least_squares.single_frame import FitData


@pytest.fixture(scope="module")
def problem():
    times, states = scenes.walk(6)
    residuals = scenes.joint_residuals(states, noise_m=0.01, outliers=0.1)
    return fit_problem(scenes.decoder(), FitData(residuals, times, Loss("geman_mcclure", 3.0)), 1)


@pytest.fixture(scope="module")
def start():
    return scenes.disturbed(scenes.walk(6)[1])


def test_the_dense_residuals_have_the_cost_and_its_gradient(problem, start):
    x, dense = problem.unknowns(start), Dense(problem)
    expected = problem.expand(x)
    found, slopes = dense.residuals(x), dense.jacobian(x)
    assert 0.5 * found @ found == pytest.approx(expected.cost, rel=1e-12)
    np.testing.assert_allclose(slopes.T @ found, expected.gradient, rtol=1e-9, atol=1e-9 * abs(expected.gradient).max())


def test_both_end_at_the_same_cost(problem, start):
    _, _, ours = fit_motion(problem, start, tolerance=TOLERANCE)
    theirs = by_scipy(problem, start)
    # each stops where another step promises less than TOLERANCE of the cost; near the minimum steps shrink by far more
    # than a half, so that what is left to gain is at most that
    assert problem.expand(theirs.x).cost == pytest.approx(ours.costs[-1], rel=2.0 * TOLERANCE)
    assert ours.costs[-1] < 0.5 * ours.costs[0]
