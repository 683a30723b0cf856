"""The benchmark of the batch fit solves the same problem with SciPy."""

import least_squares_scenes as scenes
import numpy as np
import pytest

from analysis.benchmarks.batch import TOLERANCE, Dense, by_scipy
from workbench.core.losses import Loss
from workbench.inference.least_squares.motion.all_frames import fit_motion, fit_problem
from workbench.inference.least_squares.solver.single_frame import FitData


@pytest.fixture(scope="module")
def problem():
    times, states = scenes.walk(6)
    residuals = scenes.joint_residuals(states, noise_m=0.01, outliers=0.1)
    return fit_problem(scenes.decoder(), FitData(residuals, times, Loss("geman_mcclure", 3.0)), 1)


@pytest.fixture(scope="module")
def start():
    return scenes.disturbed(scenes.walk(6)[1])


def test_dense_residuals_have_the_cost_and_gradient_of_the_problem(problem, start):
    x, dense = problem.unknowns(start), Dense(problem)
    expected = problem.expand(x)
    residuals, jacobian = dense.residuals(x), dense.jacobian(x)
    assert 0.5 * residuals @ residuals == pytest.approx(expected.cost, rel=1e-12)
    gradient, tolerance = jacobian.T @ residuals, 1e-9 * abs(expected.gradient).max()
    np.testing.assert_allclose(gradient, expected.gradient, rtol=1e-9, atol=tolerance)


def test_both_solvers_reach_the_same_cost(problem, start):
    _, _, search = fit_motion(problem, start, tolerance=TOLERANCE)
    scipy_result = by_scipy(problem, start)
    # Each stops where the predicted decrease is below TOLERANCE of the cost. Near the minimum the steps shrink by more
    # than half, so the remaining decrease is smaller still.
    assert problem.expand(scipy_result.x).cost == pytest.approx(search.costs[-1], rel=2.0 * TOLERANCE)
    assert search.costs[-1] < 0.5 * search.costs[0]
