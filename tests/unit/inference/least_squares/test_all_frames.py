"""The fit of all frames at once against finite differences, dense algebra, a Kalman smoother and known truth."""

from dataclasses import replace

import numpy as np
import pytest
from least_squares_scenes import WALKER, SineModel, decoder, disturbed, joint_residuals, walk

from workbench.core.losses import Loss
from workbench.core.prior import Smoothness
from workbench.inference.least_squares.motion.all_frames import fit_motion, fit_problem
from workbench.inference.least_squares.motion.motion_decoder import MotionDecoder
from workbench.inference.least_squares.solver.single_frame import FitData
from workbench.utils.errors import InputError

T = 8
STYLES = {"constant": T, "groups of 4": 4, "every frame": 1}
SQUARED, ROBUST = Loss("squared", 1.0), Loss("geman_mcclure", 3.0)


def unobserved(pose):
    return np.empty(0), np.empty((0, 10))


def problem(frames_per_style, loss=SQUARED, smoothness=None, **noise):
    times, states = walk(T)
    data = FitData(joint_residuals(states, **noise), times, loss, smoothness or Smoothness())
    return fit_problem(decoder(), data, frames_per_style), states


def frame_residuals(fitted, x):
    poses = fitted.decoder.poses(x[fitted.columns])
    return np.concatenate([residual(pose)[0] for residual, pose in zip(fitted.residuals, poses, strict=True)])


def central_difference(function, x, step=1e-5):
    steps = step * np.eye(len(x))
    return np.stack([(function(x + step_k) - function(x - step_k)) / (2.0 * step) for step_k in steps], axis=-1)


@pytest.mark.parametrize("frames_per_style", STYLES.values(), ids=STYLES)
def test_the_normal_equations_equal_finite_differences(frames_per_style):
    fitted, states = problem(frames_per_style, noise_m=0.02)

    def residuals(x):
        return np.concatenate([frame_residuals(fitted, x), fitted.penalty @ x])

    x = fitted.unknowns(disturbed(states))
    quadratic, jacobian, values = fitted.expand(x), central_difference(residuals, x), residuals(x)
    assert quadratic.cost == pytest.approx(0.5 * values @ values, rel=1e-12)
    # The error of central differences is step², 1e-10, plus the rounding error, about 1e-9 of the largest entry.
    normal, largest = jacobian.T @ jacobian, np.abs(jacobian.T @ jacobian).max()
    np.testing.assert_allclose(quadratic.normal.dense(), normal, rtol=1e-6, atol=1e-8 * largest)
    np.testing.assert_allclose(quadratic.gradient, jacobian.T @ values, rtol=1e-6, atol=1e-8 * largest)


@pytest.mark.parametrize("loss", [SQUARED, Loss("huber", 1.0), ROBUST], ids=lambda loss: loss.name)
def test_the_gradient_of_the_robust_cost_equals_finite_differences(loss):
    fitted, states = problem(1, loss, noise_m=0.02, outliers=0.15)
    x = fitted.unknowns(disturbed(states))
    gradient = central_difference(lambda x: np.array(fitted.expand(x).cost), x)
    np.testing.assert_allclose(fitted.expand(x).gradient, gradient, rtol=1e-6, atol=1e-6 * np.abs(gradient).max())


@pytest.mark.parametrize("frames_per_style", STYLES.values(), ids=STYLES)
def test_step_and_covariances_equal_those_of_dense_algebra(frames_per_style):
    fitted, states = problem(frames_per_style, noise_m=0.02)
    quadratic = fitted.expand(fitted.unknowns(states))
    dense, factor = quadratic.normal.dense(), quadratic.normal.factor()
    assert quadratic.normal.pattern.width < len(dense) - 1  # the band is narrower than the matrix
    np.testing.assert_allclose(factor.solve(quadratic.gradient), np.linalg.solve(dense, quadratic.gradient), rtol=1e-7)
    inverse = np.linalg.inv(dense)
    for block, columns in zip(factor.covariances(fitted.columns), fitted.columns, strict=True):
        expected = inverse[np.ix_(columns, columns)]
        np.testing.assert_allclose(block, expected, rtol=1e-6, atol=1e-9 * np.abs(expected).max())


@pytest.mark.parametrize("frames_per_style", STYLES.values(), ids=STYLES)
def test_the_truth_is_recovered_without_noise(frames_per_style):
    # With residuals of 1 µm deviation the prior of α has 1e-12 of the information of one frame.
    fitted, states = problem(frames_per_style, sigma_m=1e-6)
    estimate, _, search = fit_motion(fitted, disturbed(states), tolerance=1e-12, max_iterations=60)
    np.testing.assert_allclose(estimate, states, atol=1e-6)
    assert np.all(np.diff(search.costs) < 0.0)


def test_the_cost_decreases_to_a_stationary_point():
    fitted, states = problem(1, ROBUST, noise_m=0.01, outliers=0.15)
    start = disturbed(states)
    _, _, search = fit_motion(fitted, start, tolerance=1e-12, max_iterations=100)
    assert search.costs[0] == fitted.expand(fitted.unknowns(start)).cost
    assert len(search.costs) > 3
    assert np.all(np.diff(search.costs) < 0.0)
    last, first = (np.abs(fitted.expand(x).gradient).max() for x in (search.x, fitted.unknowns(start)))
    assert last < 1e-5 * first


def test_a_robust_loss_ignores_outliers():
    without_outliers, states = problem(T, ROBUST, noise_m=0.01, outliers=0.15, removed=True)
    expected, covariance, _ = fit_motion(without_outliers, disturbed(states))
    deviations = np.sqrt(np.diagonal(covariance, axis1=1, axis2=2))

    def largest_change(loss):
        fitted, _ = problem(T, loss, noise_m=0.01, outliers=0.15)
        return np.max(np.abs(fit_motion(fitted, disturbed(states))[0] - expected) / deviations)

    # A residual of at least 30 deviations, u ≥ 10, has an influence of u / (1 + u²)² · 3 ≤ 0.003 deviations. The 3 · 13
    # of them change no number by more than the sum of their influences, in its deviations.
    assert largest_change(ROBUST) < 0.15
    assert largest_change(SQUARED) > 10.0


def test_a_style_with_a_strong_smoothness_is_the_constant_one():
    constant, states = problem(T, noise_m=0.01)
    smooth, _ = problem(1, noise_m=0.01, smoothness=Smoothness(style=1e-5))
    expected, expected_covariance, _ = fit_motion(constant, disturbed(states), tolerance=1e-12)
    estimate, covariance, _ = fit_motion(smooth, disturbed(states), tolerance=1e-12)
    np.testing.assert_allclose(estimate, expected, atol=1e-6)
    np.testing.assert_allclose(covariance, expected_covariance, rtol=1e-4, atol=1e-9)


def test_constant_velocity_at_uneven_times_has_no_penalty():
    times, states = walk(T)
    times = times + 0.03 * np.random.default_rng(0).random(T)
    states[:, 2:] = states[0, 2:] + times[:, None] * np.arange(1.0, 8.0)
    fitted = fit_problem(decoder(), FitData(joint_residuals(states), times, SQUARED), T)
    rows = (fitted.penalty @ fitted.unknowns(states))[2:]  # the first two are those of α
    assert len(rows) == 7 * (T - 2)
    np.testing.assert_allclose(rows, 0.0, atol=1e-10)


def test_a_frame_without_observations_is_interpolated_and_less_certain():
    fitted, states = problem(1, noise_m=0.005)
    residuals = list(fitted.residuals)
    residuals[5] = unobserved
    estimate, covariance, _ = fit_motion(replace(fitted, residuals=residuals), disturbed(states))
    variances = np.trace(covariance[:, 2:, 2:], axis1=1, axis2=2)  # of phase and root
    assert variances.argmax() == 5
    deviations = np.sqrt(np.diagonal(covariance[5]))
    assert np.all(np.abs(estimate[5] - states[5]) < 4.0 * deviations)


@pytest.mark.parametrize("frames_per_style", STYLES.values(), ids=STYLES)
def test_the_cost_without_regularisation_is_the_sum_of_squares(frames_per_style):
    times, states = walk(T)
    data = FitData(joint_residuals(states, noise_m=0.02), times, SQUARED)
    fitted = fit_problem(decoder(), data, frames_per_style, plain=True)
    x = fitted.unknowns(disturbed(states))
    residuals = frame_residuals(fitted, x)
    assert fitted.expand(x).cost == pytest.approx(0.5 * residuals @ residuals, rel=1e-12)


def test_a_frame_without_observations_and_regularisation_has_unit_covariance():
    times, states = walk(T)
    residuals = joint_residuals(states, noise_m=0.005)
    residuals[5] = unobserved
    fitted = fit_problem(decoder(), FitData(residuals, times, SQUARED), 1, plain=True)
    _, covariance, _ = fit_motion(fitted, disturbed(states))
    np.testing.assert_allclose(covariance[5], np.eye(len(covariance[5])), atol=1e-9)
    assert np.diagonal(covariance[4])[-6:].max() < 0.01


def test_a_motion_without_observations_is_rejected():
    fitted, states = problem(1)
    with pytest.raises(InputError, match="do not determine the motion"):
        fit_motion(replace(fitted, residuals=[unobserved] * T), states)


class LinearModel(SineModel):
    """A model whose two angles are the phase and the coefficient, so that the problem is linear and Gaussian."""

    angles = WALKER.dof_names[6:8]
    scales = np.ones(1)

    def angles_at(self, alpha, mu):
        return np.stack([mu, alpha[..., 0]], axis=-1)

    def jacobian_at(self, alpha, mu):
        ones = np.ones_like(mu)
        return np.stack([0.0 * ones, ones], axis=-1)[..., None], np.stack([ones, 0.0 * ones], axis=-1)


def smoothed(measured, deviation, transitions, noises, mean, covariance):
    """Return the Rauch–Tung–Striebel means and variances of the first number of the state, which is measured.

    mean, covariance: of the first state given its measurement; `measured` begins with the second.
    """
    filtered, predicted = [(mean, covariance)], []
    for value, transition, noise in zip(measured, transitions, noises, strict=True):
        mean, covariance = transition @ mean, transition @ covariance @ transition.T + noise
        predicted.append((mean, covariance))
        gain = covariance[:, 0] / (covariance[0, 0] + deviation**2)
        mean, covariance = mean + gain * (value - mean[0]), covariance - np.outer(gain, covariance[0])
        filtered.append((mean, covariance))
    results = [filtered[-1]]
    backward = zip(filtered[-2::-1], predicted[::-1], transitions[::-1], strict=True)
    for (mean, covariance), (predicted_mean, predicted_covariance), transition in backward:
        gain = covariance @ transition.T @ np.linalg.inv(predicted_covariance)
        next_mean, next_covariance = results[-1]
        mean = mean + gain @ (next_mean - predicted_mean)
        results.append((mean, covariance + gain @ (next_covariance - predicted_covariance) @ gain.T))
    means, covariances = zip(*results[::-1], strict=True)
    return np.array(means)[:, 0], np.array(covariances)[:, 0, 0]


@pytest.mark.parametrize("jitter", [0.0, 0.9], ids=["even times", "uneven times"])
def test_the_solution_of_a_linear_problem_is_that_of_a_kalman_smoother(jitter):
    rng, deviation, smoothness = np.random.default_rng(3), 0.05, Smoothness(style=0.4, phase=0.03, position=0.05)
    measured = 0.2 * np.cumsum(rng.standard_normal((T, 8)), axis=0)  # of the root, the phase and the coefficient
    intervals = 1.0 + jitter * np.array([0.0, 1.5, -0.6, 2.0, -0.8, 0.3, 1.0])  # in units of 1/14 s
    times = np.concatenate([[0.0], np.cumsum(intervals)]) / 14.0
    jacobian = np.eye(10)[:8] / deviation
    residuals = [lambda pose, values=values: ((pose[:8] - values) / deviation, jacobian) for values in measured]
    data = FitData(residuals, times, SQUARED, smoothness)
    fitted = fit_problem(MotionDecoder(WALKER, LinearModel(), np.zeros(10)), data, 1)
    estimate, covariances, search = fit_motion(fitted, np.zeros((T, 8)), tolerance=1e-14)
    assert search.iterations < 12
    variances = np.diagonal(covariances, axis1=1, axis2=2)
    # The coefficient is an autoregression: of n intervals its correlation is (1 − style²)^(n/2) and its variance is 1.
    correlation = np.sqrt(1.0 - smoothness.style**2) ** intervals
    gain = 1.0 / (1.0 + deviation**2)
    mean, variance = smoothed(
        measured[1:, 7], deviation, correlation[:, None, None], (1.0 - correlation**2)[:, None, None],
        np.array([gain * measured[0, 7]]), np.array([[1.0 - gain]]),
    )  # fmt: skip
    np.testing.assert_allclose(estimate[:, 0], mean, atol=1e-7)
    np.testing.assert_allclose(variances[:, 0], variance, rtol=1e-9)
    # The other numbers have the state {x_t, x_t−1}, whose first two frames follow from their measurements alone. Their
    # velocity is a random walk from the middle of one interval to that of the next.
    previous, current = intervals[:-1], intervals[1:]
    transitions = np.array([[[1.0 + ratio, -ratio], [1.0, 0.0]] for ratio in current / previous])
    for column, source, sigma in [(1, 6, smoothness.phase), (2, 0, smoothness.position), (5, 3, smoothness.rotation)]:
        values = measured[:, source]
        noises = [np.diag([square, 0.0]) for square in (sigma * current) ** 2 * 0.5 * (previous + current)]
        mean, variance = smoothed(values[2:], deviation, transitions, noises, values[1::-1], deviation**2 * np.eye(2))
        np.testing.assert_allclose(estimate[1:, column], mean, atol=1e-7)
        np.testing.assert_allclose(variances[1:, column], variance, rtol=1e-9)


def test_times_that_do_not_increase_are_rejected():
    times, states = walk(T)
    times[3] = times[2]
    with pytest.raises(InputError, match="times of the frames to increase"):
        fit_problem(decoder(), FitData(joint_residuals(states), times, SQUARED), 1)
