"""Samples of the whole motion from the posterior of a smooth fit: their covariances and their correlation over time."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from keypoint_scenes import BODY, CAMERA, streams
from view_scenes import CAMERAS, frames, swinging

from workbench.core.frame import Frame
from workbench.core.pose_prior import PosePrior
from workbench.core.prior import PriorCapabilities
from workbench.datasets.rendering.visible import surface_points
from workbench.inference.least_squares.least_squares import LeastSquares
from workbench.inference.least_squares.motion.frame_by_frame import FrameByFrame
from workbench.inference.least_squares.motion.smooth_fit import SmoothFit
from workbench.inference.least_squares.solver.motion_posterior import N_DRAWS
from workbench.likelihoods.keypoints import KeypointLikelihood
from workbench.likelihoods.surface_points import SurfacePoints

SKELETON = BODY.skeleton
TIMES, POSES = swinging(SKELETON, 8)


def estimated_camera():
    """Return a camera whose focal length is known to 20 %."""
    by_focal = np.zeros((1, 23))
    by_focal[0, 12:14] = 0.2 * CAMERA.row[12:14]
    return replace(CAMERA, uncertainty=by_focal)


def pose_prior():
    """Return a prior whose mean is not that of the motion, which shifts the fit."""
    prior = PosePrior(np.ones(1), POSES[:, 4:].mean(axis=0)[None] + 0.1, 0.04 * np.eye(21)[None])
    return SimpleNamespace(capabilities=PriorCapabilities(pose_prior=prior))


def inference(prior=None, length_std=0.02, problem=None, **options):
    body = replace(BODY, limb_length_std=(length_std * SKELETON.offsets)[:, :, None])
    return LeastSquares(body, KeypointLikelihood(body, **options), prior, problem=problem, n_particles=20)


def posterior(cameras, sigma_px=1.0, **options):
    """Return the fit to keypoints with noise of sigma_px, and its posterior."""
    sequence = frames(SKELETON, TIMES, POSES, cameras, sigma_px)
    fit = inference(sigma_px=sigma_px, loss="squared", **options).fit_frames(sequence, POSES[0], streams()["start"])[0]
    return fit, fit.posterior


CASES = {
    "limb lengths": (CAMERAS, {}),
    "estimated camera": ([estimated_camera()], {}),
    "detector": (CAMERAS, {"systematic_errors": True}),
    "pose prior": (CAMERAS[:1], {"prior": pose_prior()}),
    "all": ([estimated_camera()], {"prior": pose_prior(), "systematic_errors": True}),
}


@pytest.mark.parametrize(("cameras", "options"), CASES.values(), ids=CASES.keys())
def test_the_samples_have_the_mean_and_the_covariances_of_the_fit(cameras, options):
    """In units of a root of each frame's covariance, in which sample variances have standard errors √(2 / n)."""
    n = 4000
    fit, motions = posterior(cameras, **options)
    samples = motions.draws(n, np.random.default_rng(0))
    assert samples.shape == (n, 8, 25)
    for t in range(8):
        white = np.linalg.solve(np.linalg.cholesky(fit.covariance[t]), (samples[:, t] - fit.poses[t]).T)
        np.testing.assert_allclose(white.mean(axis=1), 0.0, atol=5.0 / np.sqrt(n))
        np.testing.assert_allclose(white @ white.T / n, np.eye(25), atol=5.0 * np.sqrt(2.0 / n))


def test_samples_of_neighbouring_frames_are_correlated_as_by_the_dense_inverse():
    fit, motions = posterior(CAMERAS, length_std=0.0)
    n, first, last = 4000, slice(75, 100), slice(100, 125)
    errors = motions.draws(n, np.random.default_rng(0))[:, [3, 4]] - fit.poses[[3, 4]]
    factor = motions.noise
    dense = factor.solve(np.eye(200))
    expected = dense[first, last]
    deviations = np.sqrt(np.outer(np.diag(dense[first, first]), np.diag(dense[last, last])))
    sampled = errors[:, 0].T @ errors[:, 1] / n
    np.testing.assert_allclose(sampled / deviations, expected / deviations, atol=5.0 * np.sqrt(2.0 / n))
    assert np.diag(expected / deviations).max() > 0.3


def test_an_error_of_scale_is_equal_in_all_frames():
    """A person who is 5 % larger is 5 % further away, in every frame of a sample."""
    _, motions = posterior([CAMERA], sigma_px=1e-3, length_std=0.05)
    samples = motions.draws(500, np.random.default_rng(0))
    depth = CAMERA.to_camera(samples[:, :, :3])[..., 2]
    correlation = np.corrcoef(depth.T)
    assert correlation.min() > 0.999
    np.testing.assert_allclose(depth.std(axis=0) / depth.mean(axis=0), 0.05, rtol=0.15)


def test_errors_of_detected_joints_are_not_equal_in_all_frames():
    _, motions = posterior([CAMERA], sigma_px=3.0, length_std=0.0)
    depth = CAMERA.to_camera(motions.draws(500, np.random.default_rng(0))[:, :, :3])[..., 2]
    assert np.corrcoef(depth.T)[0, -1] < 0.9


def steps(problem=None, **changed_streams):
    sequence = frames(SKELETON, TIMES, POSES, CAMERAS, 1.0)
    return list(inference(problem=problem).run(sequence, POSES[0], streams() | changed_streams))


def test_samples_follow_from_their_own_stream_and_leave_the_particles_as_they_are():
    first, again, other = steps(), steps(), steps(draws=np.random.default_rng(7))
    for one, same, changed in zip(first, again, other, strict=True):
        assert one.draws.shape == (N_DRAWS, 25)
        assert one.draws.tobytes() == same.draws.tobytes() != changed.draws.tobytes()
        assert one.poses.tobytes() == same.poses.tobytes() == changed.poses.tobytes()


def test_a_smooth_fit_of_points_has_samples_of_its_covariances():
    rng, n = np.random.default_rng(0), 4000
    sequence = [Frame(t, TIMES[t], (), points=surface_points(BODY, pose, 100, rng)) for t, pose in enumerate(POSES[:3])]
    points = LeastSquares(BODY, SurfacePoints(BODY), problem=SmoothFit())
    fit = points.fit_frames(sequence, POSES[0], streams()["start"])[0]
    deviations = fit.posterior.draws(n, rng).std(axis=0)
    expected = np.sqrt(np.einsum("tpp->tp", fit.covariance))
    np.testing.assert_allclose(deviations, expected, rtol=5.0 / np.sqrt(2.0 * n))


def test_a_fit_of_single_frames_has_no_samples_of_the_motion():
    assert all(step.draws is None for step in steps(FrameByFrame()))
