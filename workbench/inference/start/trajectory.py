"""A whole body's motion from the 2-D joints that a detector found in all views, without anything set by hand."""

import logging
from collections.abc import Iterable
from dataclasses import replace

import numpy as np

from workbench.body.skeleton import Skeleton
from workbench.core.frame import Frame
from workbench.core.observations import kinds_seen, observe, person_px
from workbench.core.residual import Loss
from workbench.core.smoothness import Smoothness
from workbench.inference.fit.hypotheses import first_keypoints
from workbench.inference.fit.residuals import views_residual
from workbench.inference.fit.smooth import LEANING_SIGMA_RAD, first_poses, fit_smooth
from workbench.inference.start.keypoints import START_SIGMA
from workbench.priors.following import Trajectory

log = logging.getLogger(__name__)

RECORDED = Smoothness(position=0.013, angle=0.11)
"""Rms over 23 activities in CMU's and Bandai's recordings."""
LOSS = Loss("huber", 1.5)
"""Joints are told apart: none belongs to something else."""
MAX_ITERATIONS = 40
NO_IMAGE = np.zeros((1, 1), dtype=np.uint8)
"""In place of images that nothing looks at: all frames of a video are large."""


def trajectory_of_keypoints(skeleton: Skeleton, frames: Iterable[Frame]) -> Trajectory:
    """The motion that fits the keypoints of all views and frames best, smooth and within limits, see `fit_smooth`.

    Raises InputError where no frame shows enough keypoints to start from.
    """
    blind = [replace(frame, views=tuple(replace(view, image=NO_IMAGE) for view in frame.views)) for frame in frames]
    seen, _ = observe(blind, skeleton, 1, np.random.default_rng(0))  # which draws nothing, as there are no points
    first = first_keypoints(seen)
    sigma_px = START_SIGMA * person_px(first)
    times_s = np.array([frame.time_s for frame in blind])
    residuals = [views_residual(skeleton, one.keypoints, sigma_px, LEANING_SIGMA_RAD) for one in seen]
    cameras = {one.camera.name: one.camera for frame in seen for one in frame.keypoints}
    poses, _, _ = fit_smooth(
        skeleton, residuals, times_s, LOSS, first_poses(skeleton, first, sigma_px), RECORDED, MAX_ITERATIONS,
        shown=[bool(kinds_seen([one])) for one in seen],
        camera=next(iter(cameras.values())) if len(cameras) == 1 else None,
    )  # fmt: skip
    log.info("the whole body's motion fitted to the keypoints of %d cameras", len(cameras))
    return Trajectory(times_s - times_s[0], poses)
