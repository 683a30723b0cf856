"""Poses in the first frames, and a whole body's motion, from detected joints, without anything set by hand."""

import logging
from collections.abc import Iterable, Sequence
from dataclasses import replace

import numpy as np

from workbench.body.skeleton import Skeleton
from workbench.core.frame import Frame
from workbench.core.observations import Keypoints, Observed, observe, person_px
from workbench.core.prior import RECORDED_SMOOTHNESS, REFERENCE_RATE_HZ, Smoothness
from workbench.core.residual import Loss
from workbench.inference.least_squares.hypotheses import enough_keypoints, first_keypoints
from workbench.inference.least_squares.smooth_fit import (
    FAR_LOSS,
    candidates,
    first_poses,
    fit_smooth,
    keypoint_problem,
)
from workbench.priors.fitted_rest import Trajectory
from workbench.utils.arrays import FloatArray
from workbench.utils.errors import InputError

log = logging.getLogger(__name__)

START_S = 0.5
"""Time whose frames are looked at, every 14th of a second: what a frame alone leaves open, the way it goes on may
tell."""
START_SIGMA = 0.012
"""Of a detected joint, in heights of the person in the image: 2 cm, as detectors and their idea of a joint allow."""
LIKELY = 10.0
"""Hypotheses whose cost is higher by more than this, in nats, are given up."""

LOSS = Loss("huber", 1.5)
"""Joints are told apart: none belongs to something else."""
MAX_ITERATIONS = 40
NO_IMAGE = np.zeros((1, 1), dtype=np.uint8)
"""In place of images that nothing looks at: all frames of a video are large."""


def start_from_keypoints(skeleton: Skeleton, frames: Iterable[Frame]) -> FloatArray:
    """Find poses (n ≥ 1, P) in the first frame, the likeliest first, by all views' keypoints of the first half second.
    Each is a minimum of `smooth_fit` from another pose of the first frame. Raises InputError where that shows too
    few."""
    taken: list[Frame] = []
    for frame in frames:
        if taken and frame.time_s - taken[0].time_s > START_S:
            break
        if not taken or frame.time_s - taken[-1].time_s > 0.99 / REFERENCE_RATE_HZ:
            taken.append(frame)
    seen, _ = observe(taken, skeleton, 1, np.random.default_rng(0))  # which draws nothing, as there are no points
    if not seen or not enough_keypoints(seen[0]):
        raise InputError("dataset: expected keypoints in the first frame to start from, found too few")
    times_s = np.array([frame.time_s for frame in taken])
    return allowed_poses(skeleton, [frame.keypoints for frame in seen], times_s)


def allowed_poses(skeleton: Skeleton, seen: Sequence[Sequence[Keypoints]], times_s: FloatArray) -> FloatArray:
    """Find poses (n ≥ 1, P) in the first of some frames at times (F,), s, that the keypoints of all of them allow, the
    likeliest first: smooth motions within the body's limits, each from another pose of the first frame."""
    sigma_px = START_SIGMA * person_px(seen[0])
    observed = [Observed(np.empty((0, 3)), tuple(views)) for views in seen]
    problem = keypoint_problem(skeleton, observed, times_s, sigma_px, FAR_LOSS, smoothness=Smoothness())
    fits = candidates(problem, first_poses(skeleton, seen[0], sigma_px), max_iterations=20)
    return np.array([poses[0] for poses, cost in fits if cost < fits[0][1] + LIKELY])


def trajectory_of_keypoints(skeleton: Skeleton, frames: Iterable[Frame]) -> Trajectory:
    """Fit a whole body's motion to the keypoints of all views and frames, smooth and within limits, see `fit_smooth`.
    Raises InputError where no frame shows enough keypoints to start from."""
    blind = [replace(frame, views=tuple(replace(view, image=NO_IMAGE) for view in frame.views)) for frame in frames]
    seen, _ = observe(blind, skeleton, 1, np.random.default_rng(0))  # which draws nothing, as there are no points
    first, times_s = first_keypoints(seen), np.array([frame.time_s for frame in blind])
    sigma_px = START_SIGMA * person_px(first)
    problem = keypoint_problem(skeleton, seen, times_s, sigma_px, LOSS, smoothness=RECORDED_SMOOTHNESS)
    poses = fit_smooth(problem, seen, first_poses(skeleton, first, sigma_px), MAX_ITERATIONS).poses
    n_cameras = len({keypoints.camera.name for frame in seen for keypoints in frame.keypoints})
    log.info("the whole body's motion fitted to the keypoints of %d cameras", n_cameras)
    return Trajectory(times_s - times_s[0], poses)
