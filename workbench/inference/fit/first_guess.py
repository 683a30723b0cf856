"""Where the person is in the first frames, when nobody says: by keypoints, else by points of the surface."""

import numpy as np

from workbench.arrays import FloatArray
from workbench.body.skeleton import N_ROOT
from workbench.core.observation_residuals import surface_residual
from workbench.core.observations import Observed, kinds_seen
from workbench.core.residual import Loss, ResidualFunction, stacked
from workbench.core.smoothness import PACE_HZ
from workbench.errors import InputError
from workbench.inference.fit.decoding import MotionDecoder
from workbench.inference.fit.frame import Gaussian
from workbench.inference.fit.hypotheses import (
    KEYPOINT_LOSS,
    enough_keypoints,
    first_keypoints,
    likely_pose,
    likely_roots,
)
from workbench.inference.fit.phase_grid import roots_from_points
from workbench.inference.fit.residuals import views_residual
from workbench.inference.fit.task import Task

START_POINTS = 150
"""Points a frame that the start looks at, taken evenly from all; more only make it slower."""
START_SIGMA_M = 0.02
START_LOSS = Loss("geman_mcclure", 1.5)
"""The start always looks at distances with this deviation and loss: the field says nothing far from the body."""
START_GAP_S = 1.0 / PACE_HZ
"""The start leaves out frames that are closer than this to one before, in which a person moves little."""


def coarse_residuals(task: Task) -> tuple[list[ResidualFunction], Loss]:
    """Make what the start looks at, and its loss: some of the points, and keypoints where there are enough."""
    residuals = [_coarse(task, one) for one in task.seen]
    return residuals, START_LOSS if "points" in kinds_seen(task.seen) else KEYPOINT_LOSS


def first_roots(task: Task, decoder: MotionDecoder) -> FloatArray:
    """Find where the person may be, (n, 6), in the first frame that shows enough: by its keypoints, else by points."""
    keypoints = first_keypoints(task.seen)
    if not keypoints:
        return roots_from_points(task.skeleton, [one.points for one in task.seen], task.times_s)
    return likely_roots(decoder, keypoints, views_residual(task.skeleton, keypoints, task.sigma_px))


def first_pose(task: Task, prior: Gaussian | None) -> FloatArray:
    """Find a pose (P,) of the person there without a motion model; prior: over poses, see `likely_pose`.

    Raises InputError where points alone are seen and do not tell where the person faces.
    """
    keypoints = first_keypoints(task.seen)
    if not keypoints:
        roots = roots_from_points(task.skeleton, [one.points for one in task.seen], task.times_s)
        if len(roots) > 1:
            raise InputError("least squares: the person moves too little to tell where they face; give a start")
        return np.concatenate([roots[0], np.zeros(len(task.skeleton.dof_names) - N_ROOT)])
    return likely_pose(task.skeleton, keypoints, views_residual(task.skeleton, keypoints, task.sigma_px), prior)


def _coarse(task: Task, seen: Observed) -> ResidualFunction:
    points, keypoints = seen.points[:: max(1, len(seen.points) // START_POINTS)], enough_keypoints(seen)
    parts = [surface_residual(task.skeleton, task.surface, points, "distance", START_SIGMA_M)] * bool(len(points))
    parts += [views_residual(task.skeleton, keypoints, task.sigma_px)] * bool(keypoints)
    return stacked(parts)
