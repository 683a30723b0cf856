"""Covariances of a smooth fit under a detector's errors, against refits, dense matrices and simulation."""

from dataclasses import replace

import numpy as np
import pytest
from keypoint_scenes import BODY, streams
from view_scenes import CAMERAS, frames, observed, swinging

from workbench.body.kinematics import forward, joint_jacobian, joints
from workbench.core.frame import View
from workbench.core.losses import SQUARED
from workbench.core.prior import Smoothness
from workbench.core.residual import keypoint_residual
from workbench.inference.least_squares.least_squares import LeastSquares
from workbench.inference.least_squares.solver.motion_posterior import MotionPosterior
from workbench.inference.least_squares.solver.sparse_solver import minimise
from workbench.inference.least_squares.video.detector_errors import (
    EXTREMITY_OFFSET_STD_M,
    OFFSET_STD_M,
    camera_sensitivity,
    noise_scales,
    offset_sensitivity,
    offset_std,
    with_detector_errors,
)
from workbench.inference.least_squares.video.pose_problem import KeypointArrays, PoseProblem
from workbench.inference.least_squares.video.systematic_errors import (
    effective_fraction,
    estimated_camera_sensitivity,
    integrated_autocorrelation,
)
from workbench.likelihoods.keypoints import KeypointLikelihood

SKELETON = BODY.skeleton
SIGMA_PX = 3.0
THIRD = replace(CAMERAS[1], name="third", translation=CAMERAS[1].translation + 0.2)


def problem_of(sequence, times, assumed_px=SIGMA_PX):
    keypoints = KeypointArrays.of(observed(SKELETON, sequence), lambda weights: np.sqrt(weights) / assumed_px)
    contacts = np.zeros((len(times), 2), dtype=bool)
    return PoseProblem(SKELETON, keypoints, times, SQUARED, Smoothness(), contacts)


def fitted(problem, poses):
    return minimise(problem.expand, poses.ravel(), max_iterations=200, tolerance=1e-14)


def minimum_of(n_frames=6, cameras=CAMERAS, sigma_px=0.2, assumed_px=SIGMA_PX):
    times, poses = swinging(SKELETON, n_frames)
    problem = problem_of(frames(SKELETON, times, poses, cameras, sigma_px), times, assumed_px)
    minimum = fitted(problem, poses)
    return problem, minimum, minimum.x.reshape(poses.shape)


def shift_of_refit(problem, minimum, pixels):
    """Return the derivative (T, P) of the fitted poses in the direction `pixels`, by a finite difference."""
    step = 1e-3
    keypoints = replace(problem.keypoints, pixels=problem.keypoints.pixels + step * pixels)
    refit = fitted(replace(problem, keypoints=keypoints), minimum.x)
    return (refit.x - minimum.x).reshape(problem.n_frames, -1) / step


@pytest.mark.parametrize("joint", ["left_hip", "right_knee", "left_wrist", "pelvis"])
def test_offset_sensitivity_is_the_shift_of_a_refit(joint):
    problem, minimum, poses = minimum_of(assumed_px=1.0)
    k, keypoints = SKELETON.joint(joint), problem.keypoints
    rotations = forward(SKELETON, poses).rotations[:, max(SKELETON.parents[k], 0)]
    sensitivity = offset_sensitivity(problem, minimum.quadratic.normal.factor(), poses)
    frame_indices = np.repeat(np.arange(problem.n_frames), np.diff(keypoints.first))
    for axis in range(3):
        pixels = np.zeros_like(keypoints.pixels)
        moved = joints(SKELETON, poses)[:, k] + 1e-4 * offset_std(SKELETON)[k] * rotations[:, :, axis]
        for number, camera in enumerate(CAMERAS):
            rows = np.flatnonzero((keypoints.joints == k) & (keypoints.cameras == number))
            change = camera.project(moved) - camera.project(joints(SKELETON, poses)[:, k])
            pixels[rows] = 1e4 * change[frame_indices[rows]]
        expected = shift_of_refit(problem, minimum, pixels)
        error = sensitivity[:, :, 3 * k + axis] - expected
        assert np.linalg.norm(error) < 0.1 * np.linalg.norm(expected)  # Gauss–Newton


def test_wrists_and_ankles_have_smaller_offsets_than_other_joints():
    deviations = dict(zip(SKELETON.names, offset_std(SKELETON), strict=True))
    assert {deviations[name] for name in ("left_wrist", "right_ankle")} == {EXTREMITY_OFFSET_STD_M}
    assert {deviations[name] for name in ("left_hip", "neck", "right_elbow")} == {OFFSET_STD_M}


def test_camera_sensitivity_follows_from_the_residuals_jacobian():
    times, truth = swinging(SKELETON, 6)
    sequence = frames(SKELETON, times, truth, (*CAMERAS, THIRD), 1.0)
    problem = problem_of(sequence, times)
    minimum = fitted(problem, truth)
    poses, cameras = minimum.x.reshape(truth.shape), problem.keypoints.cameras
    residuals = SIGMA_PX * problem.residuals(poses)
    sigma = np.sqrt(sum((np.median(residuals[cameras == c], axis=0) ** 2).sum() for c in range(3)) / 3.0)
    right = np.zeros((6, 25, 3, 2))
    for t, frame in enumerate(observed(SKELETON, sequence)):
        for number, view in enumerate(frame.keypoints):
            rows = keypoint_residual(SKELETON, view.camera, view.joints, view.detections, SIGMA_PX)(poses[t])[1]
            right[t, :, number] = sigma / SIGMA_PX * rows.reshape(-1, 2, 25).sum(axis=0).T
    expected = np.linalg.solve(minimum.quadratic.normal.dense(), right.reshape(150, 6)).reshape(6, 25, 6)
    sensitivity = camera_sensitivity(problem, minimum.quadratic.normal.factor(), poses)
    np.testing.assert_allclose(sensitivity, expected, rtol=0.0, atol=1e-6 * np.abs(expected).max())


def test_the_standard_deviation_of_camera_displacements_is_estimated():
    times, poses = swinging(SKELETON, 6)
    cameras = [replace(CAMERAS[k % 2], name=f"camera {k}") for k in range(8)]
    exact, rng, ratios = problem_of(frames(SKELETON, times, poses, cameras), times), np.random.default_rng(0), []
    for _ in range(10):
        shifts = 5.0 * rng.standard_normal((8, 2))
        keypoints = replace(exact.keypoints, pixels=exact.keypoints.pixels + shifts[exact.keypoints.cameras])
        problem = replace(exact, keypoints=keypoints)
        minimum = fitted(problem, poses)
        factor = minimum.quadratic.normal.factor()
        sensitivity = camera_sensitivity(problem, factor, minimum.x.reshape(poses.shape))[:, :, 0]
        by_pixel = shift_of_refit(problem, minimum, np.outer(keypoints.cameras == 0, [1.0, 0.0]))
        ratios.append((sensitivity * by_pixel).sum() / (by_pixel**2).sum())
    assert np.sqrt(np.mean(np.square(ratios))) == pytest.approx(5.0, rel=0.2)


def test_one_camera_has_no_displacement():
    problem, minimum, poses = minimum_of(cameras=CAMERAS[:1])
    assert camera_sensitivity(problem, minimum.quadratic.normal.factor(), poses).shape == (6, 25, 0)


def test_the_covariance_with_detector_errors_equals_that_of_dense_matrices():
    problem, minimum, poses = minimum_of(12)
    wave = 20.0 * np.sin(0.3 * np.repeat(np.arange(12), 30)) * (-1.0) ** problem.keypoints.joints
    keypoints = replace(problem.keypoints, pixels=problem.keypoints.pixels + wave[:, None])
    problem = replace(problem, keypoints=keypoints)
    minimum = fitted(problem, poses)
    poses = minimum.x.reshape(poses.shape)
    (factors, n_correlated), normal = noise_scales(problem, poses), minimum.quadratic.normal
    assert factors.min() > 1.5
    assert n_correlated > 1.5
    noisy = replace(problem, keypoints=replace(keypoints, whitening=keypoints.whitening / factors))
    causes, factor = (offset_sensitivity, camera_sensitivity), normal.factor()
    errors = np.concatenate([cause(problem, factor, poses).reshape(300, -1) for cause in causes], axis=1)
    weaker = np.kron(np.eye(12), (1.0 / n_correlated - 1.0) * problem.nominal[1])  # nominal angles
    dense = np.linalg.inv(noisy.expand(minimum.x).normal.dense() + weaker) + errors @ errors.T
    blocks = np.array([dense[25 * t : 25 * t + 25, 25 * t : 25 * t + 25] for t in range(12)])
    posterior = with_detector_errors(MotionPosterior(poses, factor), problem, poses, factor)
    np.testing.assert_allclose(posterior.covariances, blocks, rtol=1e-6, atol=1e-9 * np.abs(blocks).max())


def autoregression(rho, n_frames, n_series, rng):
    noise = rng.standard_normal((n_frames, n_series, 2))
    for t in range(1, n_frames):
        noise[t] = rho * noise[t - 1] + np.sqrt(1.0 - rho**2) * noise[t]
    return noise


@pytest.mark.parametrize("rho", [0.0, 0.5, 0.9])
def test_the_autocorrelation_time_of_an_autoregression_is_estimated(rho):
    n_frames, n_series = 400, 60
    noise = autoregression(rho, n_frames, n_series, np.random.default_rng(0))
    frame, series = np.indices((n_frames, n_series)).reshape(2, -1)
    rows = np.random.default_rng(1).permutation(frame.size)[: frame.size * 3 // 4]  # in any order, with gaps
    time = integrated_autocorrelation(noise.reshape(-1, 2)[rows], series[rows], frame[rows])
    assert time == pytest.approx(1.0 / effective_fraction(rho), rel=0.12)


def test_few_residuals_count_as_independent():
    assert integrated_autocorrelation(np.ones((10, 2)), np.zeros(10, int), np.arange(10)) == 1.0


def test_independent_errors_of_the_assumed_size_are_not_scaled():
    problem, _, poses = minimum_of(30, sigma_px=SIGMA_PX)
    np.testing.assert_allclose(noise_scales(problem, poses)[0], 1.0, atol=0.2)


def fit_of(sequence, systematic_errors):
    likelihood = KeypointLikelihood(BODY, sigma_px=SIGMA_PX, loss="huber", systematic_errors=systematic_errors)
    body = replace(BODY, limb_length_std=np.zeros((15, 3, 1)))
    return LeastSquares(body, likelihood).fit_frames(sequence, None, streams()["start"])[0]


def detected(times, poses, rng):
    """Return frames of two cameras whose keypoints have constant joint offsets and autocorrelated errors."""
    rotations = forward(SKELETON, poses).rotations[:, SKELETON.parents.clip(min=0)]
    offsets = offset_std(SKELETON)[:, None] * rng.standard_normal((15, 3))
    places = joints(SKELETON, poses) + np.einsum("tjxy,jy->tjx", rotations, offsets)
    noise = [SIGMA_PX * autoregression(0.8, len(times), 15, rng) for _ in CAMERAS]

    def view(t, camera, errors):
        pixels = camera.project(places[t]) + errors[t]
        return View(camera, np.zeros((480, 640), np.uint8), np.column_stack([pixels, np.ones(15)]))

    views = [tuple(map(view, [t, t], CAMERAS, noise)) for t in range(len(times))]
    return [replace(frame, views=pair) for frame, pair in zip(frames(SKELETON, times, poses), views, strict=True)]


def coverage(fit, poses):
    jacobian = joint_jacobian(SKELETON, fit.poses)
    deviation = np.sqrt(np.einsum("tjxp,tpq,tjxq->tjx", jacobian, fit.covariance, jacobian))
    return (np.abs(joints(SKELETON, fit.poses) - joints(SKELETON, poses)) < 1.645 * deviation).mean()


def test_intervals_cover_the_errors_of_a_simulated_detector():
    """The intervals without systematic errors cover about a third of the errors."""
    times, poses = swinging(SKELETON, 40, rate_hz=28.0)
    rng, rates = np.random.default_rng(0), []
    for _ in range(5):
        sequence = detected(times, poses, rng)
        independent, systematic = (fit_of(sequence, systematic_errors) for systematic_errors in (False, True))
        assert np.array_equal(independent.poses, systematic.poses)
        rates.append([coverage(fit, poses) for fit in (independent, systematic)])
    independent_rate, systematic_rate = np.mean(rates, axis=0)
    assert independent_rate < 0.5
    assert 0.84 < systematic_rate < 0.97


def test_samples_cover_the_displacements_of_joints_over_time():
    """Constant offsets of joints cancel in the displacements, as they are equal in all frames of a sample."""
    times, poses = swinging(SKELETON, 40, rate_hz=28.0)
    rng, rates, ratios = np.random.default_rng(0), [], []

    def displacements(motions):
        places = joints(SKELETON, motions.reshape(-1, 25)).reshape(*motions.shape[:2], 15, 3)
        return places[:, 30] - places[:, 10]

    for _ in range(5):
        fit, n = fit_of(detected(times, poses, rng), systematic_errors=True), 400
        samples = fit.posterior.draws(n, rng)
        low, high = np.quantile(displacements(samples), [0.05, 0.95], axis=0)
        rates.append(((low < (truth := displacements(poses[None])[0])) & (truth < high)).mean())
        unrelated = samples.copy()
        unrelated[:, 30] = samples[::-1, 30]  # of other samples
        ratios.append((displacements(unrelated).std(axis=0) / displacements(samples).std(axis=0)).mean())
    assert 0.84 < np.mean(rates) < 0.98
    assert np.mean(ratios) > 1.3


def test_the_sensitivity_to_an_estimated_camera_is_that_of_a_refit():
    """Of the root's position; that of angles, which one camera hardly determines, is not linear."""
    problem, minimum, poses = minimum_of(cameras=CAMERAS[:1])
    changes = np.zeros((3, 23))
    changes[0, 9], changes[1, 11], changes[2, 12:14] = 0.05, 0.1, 50.0  # m, m and px: translation and focal lengths
    sensitivity = estimated_camera_sensitivity(problem, poses, changes[:, None])
    for k, change in enumerate(changes):
        step = 1e-2
        moved = [
            fitted(
                replace(problem, keypoints=replace(problem.keypoints, rows=problem.keypoints.rows + side * change)),
                minimum.x,
            )
            for side in (step, -step)
        ]
        refit = (moved[0].x - moved[1].x).reshape(poses.shape)[:, :3] / (2.0 * step)
        np.testing.assert_allclose(sensitivity[:, :3, k], refit, atol=0.1 * np.abs(refit).max())


def test_the_depth_is_as_uncertain_as_an_estimated_focal_length():
    """A focal length that is known to 20 % leaves the distance unknown by 20 %; without an error nothing is added."""
    times, poses = swinging(SKELETON, 6)
    camera = CAMERAS[0]
    by_focal = np.zeros((1, 23))
    by_focal[0, 12:14] = 0.2 * camera.row[12:14]
    depth_std = []
    for uncertainty in (None, 0.0 * by_focal, by_focal):
        sequence = frames(SKELETON, times, poses, [replace(camera, uncertainty=uncertainty)], 0.2)
        likelihood = KeypointLikelihood(BODY, sigma_px=SIGMA_PX, loss="squared")
        fit = LeastSquares(BODY, likelihood).fit_frames(sequence, poses[0], streams()["start"])[0]
        axis = camera.rotation[2]
        depth_std.append(np.sqrt(np.median(axis @ fit.covariance[:, :3, :3] @ axis)))
    depth_m = np.median(camera.to_camera(poses[:, :3])[:, 2])
    assert depth_std[0] == pytest.approx(depth_std[1])
    assert np.sqrt(depth_std[2] ** 2 - depth_std[0] ** 2) == pytest.approx(0.2 * depth_m, rel=0.1)
