"""The fit over all frames at once against finite differences, dense algebra, closed forms and known truth."""

from dataclasses import replace

import numpy as np
import pytest
from least_squares_scenes import WALKER, SineModel, decoder, disturbed, joint_residuals, walk

from workbench.core.prior import Smoothness
from workbench.core.residual import Loss
from workbench.inference.least_squares.all_frames import fit_motion, fit_problem
from workbench.inference.least_squares.single_frame import FitData, MotionDecoder
from workbench.utils.errors import InputError

T = 8
STYLES = {"steady": T, "groups of 4": 4, "frame": 1}
SQUARED, ROBUST = Loss("squared", 1.0), Loss("geman_mcclure", 3.0)


def problem(frames_per_style, loss=SQUARED, smoothness=None, **scene):
    times, states = walk(T)
    data = FitData(joint_residuals(states, **scene), times, loss, smoothness or Smoothness())
    return fit_problem(decoder(), data, frames_per_style), states


def whole_residual(fitted, x):
    """Every whitened residual and row of the penalty."""
    poses = fitted.decoder.poses(x[fitted.columns])
    misses = [residual(pose)[0] for residual, pose in zip(fitted.residuals, poses, strict=True)]
    return np.concatenate([*misses, fitted.penalty @ x])


def central(function, x, step=1e-5):
    moves = step * np.eye(len(x))
    return np.stack([(function(x + move) - function(x - move)) / (2.0 * step) for move in moves], axis=-1)


@pytest.mark.parametrize("frames_per_style", STYLES.values(), ids=STYLES)
def test_the_normal_equations_are_those_of_the_finite_differences(frames_per_style):
    fitted, states = problem(frames_per_style, noise_m=0.02)
    x = fitted.unknowns(disturbed(states))
    quadratic, jacobian = fitted.expand(x), central(lambda x: whole_residual(fitted, x), x)
    misses = whole_residual(fitted, x)
    assert quadratic.cost == pytest.approx(0.5 * misses @ misses, rel=1e-12)
    # central differences are good to step², 1e-10, and to rounding over the step, about 1e-9 of the largest entry
    exact, largest = jacobian.T @ jacobian, np.abs(jacobian.T @ jacobian).max()
    np.testing.assert_allclose(quadratic.normal.dense(), exact, rtol=1e-6, atol=1e-8 * largest)
    np.testing.assert_allclose(quadratic.gradient, jacobian.T @ misses, rtol=1e-6, atol=1e-8 * largest)


@pytest.mark.parametrize("loss", [SQUARED, Loss("huber", 1.0), ROBUST], ids=lambda loss: loss.name)
def test_the_gradient_is_that_of_the_robust_cost(loss):
    fitted, states = problem(1, loss, noise_m=0.02, outliers=0.15)
    x = fitted.unknowns(disturbed(states))
    exact = central(lambda x: np.array(fitted.expand(x).cost), x)
    np.testing.assert_allclose(fitted.expand(x).gradient, exact, rtol=1e-6, atol=1e-6 * np.abs(exact).max())


@pytest.mark.parametrize("frames_per_style", STYLES.values(), ids=STYLES)
def test_step_and_covariances_equal_those_of_dense_algebra(frames_per_style):
    fitted, states = problem(frames_per_style, noise_m=0.02)
    quadratic = fitted.expand(fitted.unknowns(states))
    dense, factor = quadratic.normal.dense(), quadratic.normal.factor()
    assert quadratic.normal.pattern.width < len(dense) - 1  # the pattern is narrower than the matrix
    np.testing.assert_allclose(factor.solve(quadratic.gradient), np.linalg.solve(dense, quadratic.gradient), rtol=1e-7)
    inverse = np.linalg.inv(dense)
    for block, own in zip(factor.covariances(fitted.columns), fitted.columns, strict=True):
        expected = inverse[np.ix_(own, own)]
        np.testing.assert_allclose(block, expected, rtol=1e-6, atol=1e-9 * np.abs(expected).max())


@pytest.mark.parametrize("frames_per_style", STYLES.values(), ids=STYLES)
def test_finds_the_truth_without_noise(frames_per_style):
    # residuals of 1 µm deviation: the pull of the prior on α is 1e-12 over what a frame shows of it
    fitted, states = problem(frames_per_style, sigma_m=1e-6)
    found, _, search = fit_motion(fitted, disturbed(states), tolerance=1e-12, max_iterations=60)
    np.testing.assert_allclose(found, states, atol=1e-6)
    assert np.all(np.diff(search.costs) < 0.0)


def test_cost_never_rises_and_ends_at_a_stationary_point():
    fitted, states = problem(1, ROBUST, noise_m=0.01, outliers=0.15)
    start = disturbed(states)
    _, _, search = fit_motion(fitted, start, tolerance=1e-12, max_iterations=100)
    assert search.costs[0] == fitted.expand(fitted.unknowns(start)).cost
    assert len(search.costs) > 3
    assert np.all(np.diff(search.costs) < 0.0)
    steepest, first = (np.abs(fitted.expand(x).gradient).max() for x in (search.x, fitted.unknowns(start)))
    assert steepest < 1e-5 * first


def test_a_robust_loss_ignores_outliers():
    clean, states = problem(T, ROBUST, noise_m=0.01, outliers=0.15, removed=True)
    spoiled, _ = problem(T, ROBUST, noise_m=0.01, outliers=0.15)
    plain, _ = problem(T, SQUARED, noise_m=0.01, outliers=0.15)
    expected, covariance, _ = fit_motion(clean, disturbed(states))
    deviations = np.sqrt(np.diagonal(covariance, axis1=1, axis2=2))
    away = [np.abs(fit_motion(fitted, disturbed(states))[0] - expected) / deviations for fitted in (spoiled, plain)]
    # a residual of 30 deviations or more pulls with u / (1 + u²)² · 3 ≤ 0.003 of one, u ≥ 10; all 3 · 13 of them
    # together move no number by more than their sum in its own deviations
    assert away[0].max() < 0.15
    assert away[1].max() > 10.0


def test_a_style_that_may_not_change_is_the_steady_one():
    steady, states = problem(T, noise_m=0.01)
    still, _ = problem(1, noise_m=0.01, smoothness=Smoothness(style=1e-5))
    expected, covariance, _ = fit_motion(steady, disturbed(states), tolerance=1e-12)
    found, spread, _ = fit_motion(still, disturbed(states), tolerance=1e-12)
    np.testing.assert_allclose(found, expected, atol=1e-6)
    np.testing.assert_allclose(spread, covariance, rtol=1e-4, atol=1e-9)


def test_constant_speed_costs_nothing_at_uneven_times():
    times, states = walk(T)
    times = times + 0.03 * np.random.default_rng(0).random(T)
    slope = np.arange(1.0, 8.0)
    states[:, 2:] = states[0, 2:] + times[:, None] * slope
    fitted = fit_problem(decoder(), FitData(joint_residuals(states), times, SQUARED), T)
    rows = (fitted.penalty @ fitted.unknowns(states))[2:]  # the first two are those of α
    assert len(rows) == 7 * (T - 2)
    np.testing.assert_allclose(rows, 0.0, atol=1e-10)


def test_a_frame_without_observations_is_bridged_and_less_certain():
    fitted, states = problem(1, noise_m=0.005)
    hidden = list(fitted.residuals)
    hidden[5] = lambda pose: (np.empty(0), np.empty((0, 10)))
    found, covariance, _ = fit_motion(replace(fitted, residuals=hidden), disturbed(states))
    spread = np.trace(covariance[:, 2:, 2:], axis1=1, axis2=2)  # of phase and root
    assert spread.argmax() == 5
    deviations = np.sqrt(np.diagonal(covariance[5]))
    assert np.all(np.abs(found[5] - states[5]) < 4.0 * deviations)


@pytest.mark.parametrize("frames_per_style", STYLES.values(), ids=STYLES)
def test_without_regularisation_the_cost_is_the_papers_sum_of_squares(frames_per_style):
    times, states = walk(T)
    data = FitData(joint_residuals(states, noise_m=0.02), times, SQUARED)
    fitted = fit_problem(decoder(), data, frames_per_style, plain=True)
    x = fitted.unknowns(disturbed(states))
    poses = fitted.decoder.poses(x[fitted.columns])
    squares = [residual(pose)[0] @ residual(pose)[0] for residual, pose in zip(fitted.residuals, poses, strict=True)]
    assert fitted.expand(x).cost == pytest.approx(0.5 * sum(squares), rel=1e-12)


def test_without_regularisation_a_frame_that_shows_nothing_is_as_uncertain_as_can_be():
    times, states = walk(T)
    residuals = joint_residuals(states, noise_m=0.005)
    residuals[5] = lambda pose: (np.empty(0), np.empty((0, 10)))
    fitted = fit_problem(decoder(), FitData(residuals, times, SQUARED), 1, plain=True)
    _, covariance, _ = fit_motion(fitted, disturbed(states))
    np.testing.assert_allclose(covariance[5], np.eye(len(covariance[5])), atol=1e-9)
    assert np.diagonal(covariance[4])[-6:].max() < 0.01


def test_no_observation_at_all_is_an_error():
    fitted, states = problem(1)
    empty = replace(fitted, residuals=[lambda pose: (np.empty(0), np.empty((0, 10)))] * T)
    with pytest.raises(InputError, match="do not determine the motion"):
        fit_motion(empty, states)


class LinearModel(SineModel):
    """Two angles are the phase and the coefficient themselves, so that the whole problem is linear and Gaussian."""

    angles = WALKER.dof_names[6:8]
    scales = np.ones(1)

    def angles_at(self, alpha, mu):
        return np.stack([mu, alpha[..., 0]], axis=-1)

    def jacobian_at(self, alpha, mu):
        ones = np.ones_like(mu)
        return np.stack([0.0 * ones, ones], axis=-1)[..., None], np.stack([ones, 0.0 * ones], axis=-1)


def smoothed(measured, deviation, transitions, noises, mean, covariance):
    """Rauch–Tung–Striebel: means and variances of the first number of the state, `measured` from the second frame on
    with the state of the first, given as mean and covariance, already knowing its own measurement."""
    filtered, predicted = [(mean, covariance)], []
    for value, transition, noise in zip(measured, transitions, noises, strict=True):
        mean, covariance = transition @ mean, transition @ covariance @ transition.T + noise
        predicted.append((mean, covariance))
        gain = covariance[:, 0] / (covariance[0, 0] + deviation**2)
        mean, covariance = mean + gain * (value - mean[0]), covariance - np.outer(gain, covariance[0])
        filtered.append((mean, covariance))
    rows = [filtered[-1]]
    back = zip(filtered[-2::-1], predicted[::-1], transitions[::-1], strict=True)
    for (mean, covariance), (ahead, spread), transition in back:
        gain = covariance @ transition.T @ np.linalg.inv(spread)
        later, width = rows[-1]
        rows.append((mean + gain @ (later - ahead), covariance + gain @ (width - spread) @ gain.T))
    return np.array([row[0][0] for row in rows[::-1]]), np.array([row[1][0, 0] for row in rows[::-1]])


@pytest.mark.parametrize("jitter", [0.0, 0.9], ids=["even times", "uneven times"])
def test_a_linear_problem_is_solved_as_the_kalman_smoother_does(jitter):
    rng, deviation, smoothness = np.random.default_rng(3), 0.05, Smoothness(style=0.4, phase=0.03, position=0.05)
    measured = 0.2 * np.cumsum(rng.standard_normal((T, 8)), axis=0)  # the root, then phase and coefficient
    gaps = 1.0 + jitter * np.array([0.0, 1.5, -0.6, 2.0, -0.8, 0.3, 1.0])  # between frames, in those at 14 Hz
    times = np.concatenate([[0.0], np.cumsum(gaps)]) / 14.0
    poses = MotionDecoder(WALKER, LinearModel(), np.zeros(10))
    rows = np.eye(10)[:8]
    residuals = [
        lambda pose, seen=seen: ((pose[:8] - seen) / deviation, rows / deviation) for seen in measured
    ]  # fmt: skip
    fitted = fit_problem(poses, FitData(residuals, times, SQUARED, smoothness), 1)
    found, covariances, search = fit_motion(fitted, np.zeros((T, 8)), tolerance=1e-14)
    assert search.iterations < 12
    variances = np.diagonal(covariances, axis1=1, axis2=2)
    # n frames at 14 Hz keep (1 − style²)^(n/2) of a coefficient, whose variance stays 1
    kept = np.sqrt(1.0 - smoothness.style**2) ** gaps
    gain = 1.0 / (1.0 + deviation**2)
    mean, variance = smoothed(
        measured[1:, 7], deviation, kept[:, None, None], (1.0 - kept**2)[:, None, None],
        np.array([gain * measured[0, 7]]), np.array([[1.0 - gain]]),
    )  # fmt: skip
    np.testing.assert_allclose(found[:, 0], mean, atol=1e-7)
    np.testing.assert_allclose(variances[:, 0], variance, rtol=1e-9)
    # two frames are known by their measurements alone, the state is {x_t, x_t−1}; x goes on at its last speed, which is
    # a random walk from the middle of one gap to that of the next
    before, after = gaps[:-1], gaps[1:]
    transitions = np.array([[[1.0 + r, -r], [1.0, 0.0]] for r in after / before])
    for column, shown, spread in [(1, 6, smoothness.phase), (2, 0, smoothness.position), (5, 3, smoothness.rotation)]:
        seen = measured[:, shown]
        noises = [np.diag([square, 0.0]) for square in (spread * after) ** 2 * 0.5 * (before + after)]
        first = seen[1::-1], deviation**2 * np.eye(2)
        mean, variance = smoothed(seen[2:], deviation, transitions, noises, *first)
        np.testing.assert_allclose(found[1:, column], mean, atol=1e-7)
        np.testing.assert_allclose(variances[1:, column], variance, rtol=1e-9)


def test_times_that_do_not_increase_are_an_error():
    times, states = walk(T)
    times[3] = times[2]
    with pytest.raises(InputError, match="times of the frames to increase"):
        fit_problem(decoder(), FitData(joint_residuals(states), times, SQUARED), 1)
