"""The start of a filter from detected joints: poses that the first frames allow, without anything set by hand."""

from collections.abc import Iterable, Sequence

import numpy as np

from workbench.arrays import FloatArray
from workbench.body.skeleton import Skeleton
from workbench.core.frame import Frame
from workbench.core.observations import Keypoints, observe, person_px
from workbench.core.smoothness import PACE_HZ, Smoothness
from workbench.errors import InputError
from workbench.inference.fit.hypotheses import enough_keypoints
from workbench.inference.fit.residuals import views_residual
from workbench.inference.fit.smooth import LEANING_SIGMA_RAD, candidates, first_poses

START_S = 0.5
"""Time whose frames are looked at, every 14th of a second: what a frame alone leaves open, the way it goes on may
tell."""
START_SIGMA = 0.012
"""Of a detected joint, in heights of the person in the image: 2 cm, as detectors and their idea of a joint allow."""
LIKELY = 10.0
"""Hypotheses whose cost is higher by more than this, in nats, are given up."""


def start_from_keypoints(skeleton: Skeleton, frames: Iterable[Frame]) -> FloatArray:
    """Poses (n ≥ 1, P) in the first frame, the likeliest first, from the keypoints of all views in the first half
    second.

    Each is a minimum of `smooth_fit` from another pose of the first frame. Raises InputError where that shows too few
    keypoints.
    """
    taken: list[Frame] = []
    for frame in frames:
        if taken and frame.time_s - taken[0].time_s > START_S:
            break
        if not taken or frame.time_s - taken[-1].time_s > 0.99 / PACE_HZ:
            taken.append(frame)
    seen, _ = observe(taken, skeleton, 1, np.random.default_rng(0))  # which draws nothing, as there are no points
    if not seen or not enough_keypoints(seen[0]):
        raise InputError("dataset: expected keypoints in the first frame to start from, found too few")
    times_s = np.array([frame.time_s for frame in taken])
    return allowed_poses(skeleton, [one.keypoints for one in seen], times_s)


def allowed_poses(skeleton: Skeleton, seen: Sequence[Sequence[Keypoints]], times_s: FloatArray) -> FloatArray:
    """Poses (n ≥ 1, P) in the first of some frames at times (F,), s, that the keypoints of all of them allow, the
    likeliest first: smooth motions within the body's limits, each from another pose of the first frame."""
    sigma_px = START_SIGMA * person_px(seen[0])
    residuals = [views_residual(skeleton, views, sigma_px, LEANING_SIGMA_RAD) for views in seen]
    starts = first_poses(skeleton, seen[0], sigma_px)
    found = candidates(skeleton, residuals, times_s, starts, Smoothness(), max_iterations=20)
    return np.array([poses[0] for poses, cost in found if cost < found[0][1] + LIKELY])
