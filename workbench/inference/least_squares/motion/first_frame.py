"""Initial roots and poses in the first frames of a task, from points or keypoints."""

from collections.abc import Sequence

import numpy as np

from workbench.body.angles import wrapped
from workbench.body.kinematics import joints
from workbench.body.skeleton import N_ROOT, Skeleton
from workbench.core.losses import POINT_LOSS, SEARCH_LOSS
from workbench.core.observations import Keypoints, Observed, observed_kinds
from workbench.core.residual import ResidualFunction, stacked, surface_residual
from workbench.inference.least_squares.motion.motion_decoder import MotionDecoder
from workbench.inference.least_squares.motion.phase_grid import N_FRAMES, N_PHASES
from workbench.inference.least_squares.motion.task import Task
from workbench.inference.least_squares.solver.residuals import views_residual
from workbench.inference.least_squares.solver.single_frame import FitData, PoseDecoder, fit_frame
from workbench.inference.least_squares.video.hypotheses import (
    N_HEADINGS,
    enough_keypoints,
    first_keypoints,
    likely_poses,
    upright_roots,
)
from workbench.utils.arrays import FloatArray
from workbench.utils.errors import InputError

START_POINTS = 150
"""Points per frame in the initial search, at a regular stride; more only cost time."""
START_SIGMA_M = 0.02
"""The initial search uses distances with this standard deviation, because the field vanishes far from the body."""
MIN_TRAVEL_M = 0.1
"""Smallest displacement over the first frames that determines the heading."""
N_SELECTED = 2
_MIN_HEADING_GAP_RAD = np.pi / 4.0  # between two selected roots


def coarse_data(task: Task) -> FitData:
    """Return the residuals of the initial search: a subset of the points, and keypoints where a view has enough."""
    loss = POINT_LOSS if "points" in observed_kinds(task.observations) else SEARCH_LOSS
    return FitData([_coarse_residual(task, frame) for frame in task.observations], task.times_s, loss, task.smoothness)


def _coarse_residual(task: Task, observed: Observed) -> ResidualFunction:
    points, keypoints = observed.points[:: max(1, len(observed.points) // START_POINTS)], enough_keypoints(observed)
    terms = [surface_residual(task.skeleton, task.surface, points, "distance", START_SIGMA_M)] * bool(len(points))
    terms += [views_residual(task.skeleton, keypoints, task.sigma_px)] * bool(keypoints)
    return stacked(terms)


def first_roots(task: Task, decoder: MotionDecoder) -> FloatArray:
    """Return candidate roots (n, 6) in the first frame with enough observations, by its keypoints, else by points."""
    keypoints = first_keypoints(task.observations)
    if not keypoints:
        return roots_from_points(task.skeleton, [frame.points for frame in task.observations], task.times_s)
    return likely_roots(decoder, keypoints, views_residual(task.skeleton, keypoints, task.sigma_px))


def first_pose(task: Task) -> FloatArray:
    """Return an initial pose (P,) in that frame without a motion model. Raises InputError if points alone do not
    determine the heading."""
    keypoints = first_keypoints(task.observations)
    if not keypoints:
        roots = roots_from_points(task.skeleton, [frame.points for frame in task.observations], task.times_s)
        if len(roots) > 1:
            raise InputError("least squares: the person moves too little to determine the heading; set an initial pose")
        return np.concatenate([roots[0], np.zeros(len(task.skeleton.dof_names) - N_ROOT)])
    residual = views_residual(task.skeleton, keypoints, task.sigma_px)
    return likely_poses(task.skeleton, keypoints, residual, None, 1)[0]


def likely_roots(decoder: MotionDecoder, views: Sequence[Keypoints], residual: ResidualFunction) -> FloatArray:
    """Return the best roots (n ≤ N_SELECTED, 6) in one frame of keypoints, over the phases of the mean motion and
    N_HEADINGS headings; their headings differ by more than 45°."""
    free, columns, fits = PoseDecoder(decoder.skeleton), np.arange(N_ROOT), []
    phases = np.arange(N_PHASES) / N_PHASES
    for pose in decoder.poses(decoder.states(np.zeros(decoder.n_style), phases, np.zeros(N_ROOT))):
        for root in upright_roots(decoder.skeleton, views, pose):
            guess = np.concatenate([root, pose[N_ROOT:]])
            fits.append(fit_frame(free, residual, SEARCH_LOSS, guess, free=columns, max_iterations=8, tolerance=1e-2))
    selected: list[FloatArray] = []
    for fit in sorted(fits, key=lambda fit: fit.costs[-1]):
        root = fit.x[:N_ROOT]
        differences = [abs(wrapped(root[3] - other[3])) for other in selected]
        if len(selected) < N_SELECTED and all(angle > _MIN_HEADING_GAP_RAD for angle in differences):
            selected.append(root)
    return np.array(selected)


def roots_from_points(skeleton: Skeleton, points: Sequence[FloatArray], times_s: FloatArray) -> FloatArray:
    """Return initial roots (n, 6) in the first of some frames of points (K, 3), m: upright, at the median of the
    points, heading in the direction of motion over the first frames, or in N_HEADINGS directions if the motion is below
    MIN_TRAVEL_M.

    Raises InputError without points in two of the first frames. Medians are robust to outliers, but not to a wall
    behind the person.
    """
    visible = [t for t, cloud in enumerate(points[:N_FRAMES]) if len(cloud)]
    if len(visible) < 2:
        raise InputError("least squares: expected points in two of the first frames, found fewer")
    medians = np.array([np.median(points[t], axis=0) for t in visible])
    line = np.polynomial.polynomial.polyfit(times_s[visible] - times_s[0], medians, 1)
    travel = line[1, :2] * (times_s[visible[-1]] - times_s[visible[0]])
    moves = np.linalg.norm(travel) >= MIN_TRAVEL_M
    headings = np.arange(N_HEADINGS) * 2.0 * np.pi / N_HEADINGS
    poses = np.zeros((1 if moves else N_HEADINGS, len(skeleton.dof_names)))
    poses[:, 3] = np.arctan2(travel[1], travel[0]) if moves else headings
    poses[:, :3] = line[0] - joints(skeleton, poses).mean(axis=1)
    return poses[:, :N_ROOT]
