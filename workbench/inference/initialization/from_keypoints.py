"""Initial poses, and a whole body's motion, fitted to detected joints without manual initialization."""

import logging
from collections.abc import Iterable, Sequence

import numpy as np

from workbench.body.skeleton import Skeleton
from workbench.core.frame import Frame
from workbench.core.frame_cache import without_images
from workbench.core.losses import KEYPOINT_TRAJECTORY_LOSS, SEARCH_LOSS
from workbench.core.observations import Keypoints, Observed, observe, person_px
from workbench.core.prior import RECORDED_SMOOTHNESS, REFERENCE_RATE_HZ, Smoothness
from workbench.inference.least_squares.motion.smooth_fit import (
    candidates,
    first_poses,
    fit_smooth,
    keypoint_problem,
)
from workbench.inference.least_squares.video.hypotheses import enough_keypoints, first_keypoints
from workbench.priors.fitted_rest import Trajectory
from workbench.utils.arrays import FloatArray
from workbench.utils.errors import InputError

log = logging.getLogger(__name__)

START_S = 0.5
"""Time over which frames are used, every 14th of a second: subsequent frames resolve ambiguities of a single one."""
START_SIGMA = 0.012
"""Standard deviation of a detected joint, in heights of the person in the image: 2 cm, errors of detection and of the
joint's definition."""
MAX_COST_GAP = 10.0
"""Nats: hypotheses with a higher cost than the best one by this are rejected."""

MAX_ITERATIONS = 40


def poses_from_keypoints(skeleton: Skeleton, frames: Iterable[Frame]) -> FloatArray:
    """Return poses (n ≥ 1, P) in the first frame, the likeliest first, fitted to all views' keypoints of the first half
    second.

    Each is a minimum of `smooth_fit` from another pose of the first frame. Raises InputError if the first frame has too
    few keypoints.
    """
    selected: list[Frame] = []
    for frame in without_images(frames):
        if selected and frame.time_s - selected[0].time_s > START_S:
            break
        if not selected or frame.time_s - selected[-1].time_s > 0.99 / REFERENCE_RATE_HZ:
            selected.append(frame)
    observations, _ = observe(
        selected, skeleton, 1, np.random.default_rng(0)
    )  # which draws nothing, as there are no points
    if not observations or not enough_keypoints(observations[0]):
        raise InputError("dataset: expected keypoints in the first frame to start from, found too few")
    times_s = np.array([frame.time_s for frame in selected])
    return consistent_poses(skeleton, [frame.keypoints for frame in observations], times_s)


def consistent_poses(
    skeleton: Skeleton, views_of_frames: Sequence[Sequence[Keypoints]], times_s: FloatArray
) -> FloatArray:
    """Return poses (n ≥ 1, P) in the first of F frames at times (F,), s, that agree with the keypoints of all of them,
    the likeliest first: smooth motions within the body's limits, each from another pose of the first frame."""
    sigma_px = START_SIGMA * person_px(views_of_frames[0])
    frames = [Observed(np.empty((0, 3)), tuple(views)) for views in views_of_frames]
    problem = keypoint_problem(skeleton, frames, times_s, sigma_px, SEARCH_LOSS, smoothness=Smoothness())
    fits = candidates(problem, first_poses(skeleton, views_of_frames[0], sigma_px), max_iterations=20)
    return np.array([poses[0] for poses, cost in fits if cost < fits[0][1] + MAX_COST_GAP])


def trajectory_of_keypoints(skeleton: Skeleton, frames: Iterable[Frame]) -> Trajectory:
    """Return a whole body's motion fitted to the keypoints of all views and frames, smooth and within limits, see
    `fit_smooth`. Raises InputError if no frame has enough keypoints to start from."""
    observed = list(without_images(frames))
    observations, _ = observe(
        observed, skeleton, 1, np.random.default_rng(0)
    )  # which draws nothing, as there are no points
    first, times_s = first_keypoints(observations), np.array([frame.time_s for frame in observed])
    sigma_px = START_SIGMA * person_px(first)
    problem = keypoint_problem(
        skeleton, observations, times_s, sigma_px, KEYPOINT_TRAJECTORY_LOSS, smoothness=RECORDED_SMOOTHNESS
    )
    poses = fit_smooth(problem, observations, first_poses(skeleton, first, sigma_px), MAX_ITERATIONS).poses
    n_cameras = len({keypoints.camera.name for frame in observations for keypoints in frame.keypoints})
    log.info("whole-body motion fitted to the keypoints of %d cameras", n_cameras)
    return Trajectory(times_s - times_s[0], poses)
