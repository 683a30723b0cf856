"""Initial roots and poses of a person from the 2-D joints of one frame."""

from collections.abc import Sequence

import numpy as np

from workbench.body.angles import wrapped
from workbench.body.kinematics import joints
from workbench.body.skeleton import N_ROOT, Skeleton
from workbench.core.observations import Keypoints, Observed, observed_kinds
from workbench.core.residual import Loss, ResidualFunction, stacked, surface_residual
from workbench.inference.least_squares.motion.phase_grid import N_HEADINGS, N_PHASES, roots_from_points
from workbench.inference.least_squares.motion.task import Task
from workbench.inference.least_squares.solver.residuals import views_residual
from workbench.inference.least_squares.solver.single_frame import (
    FitData,
    GaussianPrior,
    MotionDecoder,
    PoseDecoder,
    fit_frame,
)
from workbench.utils.arrays import FloatArray
from workbench.utils.errors import InputError

MIN_KEYPOINTS = 4
"""In one view of the first frame, to determine the six parameters of the root and a phase."""
KEYPOINT_LOSS = Loss("huber", 3.0)
"""Of the initial search by keypoints: not redescending, because the joint of a keypoint is certain."""
N_SELECTED = 2
MIN_SEPARATION_M = 0.1
_MIN_HEADING_GAP_RAD = np.pi / 4.0  # between two selected roots
START_POINTS = 150
"""Points per frame in the initial search, at a regular stride; more only cost time."""
START_SIGMA_M = 0.02
START_LOSS = Loss("geman_mcclure", 1.5)
"""The initial search uses distances with this standard deviation and loss, because the field vanishes far from the
body."""


def enough_keypoints(observed: Observed) -> tuple[Keypoints, ...]:
    """Return the frame's keypoints if some view has at least MIN_KEYPOINTS, else none."""
    return observed.keypoints if any(len(view.joints) >= MIN_KEYPOINTS for view in observed.keypoints) else ()


def first_keypoints(observations: Sequence[Observed]) -> tuple[Keypoints, ...]:
    """Return the keypoints of the first frame with enough observations, none if these are points; raises InputError
    without such a frame."""
    for frame in observations:
        if len(frame.points) or enough_keypoints(frame):
            return enough_keypoints(frame)
    raise InputError(f"least squares: expected {MIN_KEYPOINTS} keypoints in some frame to start from, found fewer")


def likely_roots(decoder: MotionDecoder, views: Sequence[Keypoints], residual: ResidualFunction) -> FloatArray:
    """Return the best roots (n ≤ N_SELECTED, 6) in one frame of keypoints, over the phases of the mean motion and
    N_HEADINGS headings; their headings differ by more than 45°."""
    free, columns, fits = PoseDecoder(decoder.skeleton), np.arange(N_ROOT), []
    phases = np.arange(N_PHASES) / N_PHASES
    for pose in decoder.poses(decoder.states(np.zeros(decoder.n_style), phases, np.zeros(N_ROOT))):
        for root in upright_roots(decoder.skeleton, views, pose):
            guess = np.concatenate([root, pose[N_ROOT:]])
            fits.append(fit_frame(free, residual, KEYPOINT_LOSS, guess, free=columns, max_iterations=8, tolerance=1e-2))
    selected: list[FloatArray] = []
    for fit in sorted(fits, key=lambda fit: fit.costs[-1]):
        root = fit.x[:N_ROOT]
        differences = [abs(wrapped(root[3] - other[3])) for other in selected]
        if len(selected) < N_SELECTED and all(angle > _MIN_HEADING_GAP_RAD for angle in differences):
            selected.append(root)
    return np.array(selected)


def likely_poses(
    skeleton: Skeleton,
    views: Sequence[Keypoints],
    residual: ResidualFunction,
    prior: GaussianPrior | None,
    max_poses: int,
) -> FloatArray:
    """Return the best poses (n ≤ max_poses, P) in one frame of keypoints without a motion model, the best first.

    They are minima from N_HEADINGS headings with a mean joint distance of at least MIN_SEPARATION_M between them.
    prior: over poses, else over the lean only; angles without prior are regularised by the damping of the search.
    """
    upright = upright_poses(skeleton, views, np.zeros(len(skeleton.dof_names)) if prior is None else prior.mean)
    fits = [fit_frame(PoseDecoder(skeleton), residual, KEYPOINT_LOSS, pose, prior=prior) for pose in upright]
    fits.sort(key=lambda fit: fit.costs[-1])
    return distinct_poses(skeleton, np.array([fit.x for fit in fits]), max_poses, MIN_SEPARATION_M)


def distinct_poses(skeleton: Skeleton, poses: FloatArray, max_poses: int, min_separation_m: float) -> FloatArray:
    """Return the first poses (k ≤ max_poses, P) of `poses` whose mean joint distance from all previous ones exceeds
    min_separation_m."""
    positions, selected = joints(skeleton, poses), np.empty(0, dtype=np.intp)
    for k in range(len(poses)):
        distances = np.linalg.norm(positions[selected] - positions[k], axis=2).mean(axis=1)
        if len(selected) < max_poses and (distances > min_separation_m).all():
            selected = np.append(selected, k)
    return poses[selected]


def upright_poses(skeleton: Skeleton, views: Sequence[Keypoints], mean: FloatArray) -> FloatArray:
    """Return poses (N_HEADINGS, P) with the angles of `mean` (P,), no lean and the roots of `upright_roots`."""
    angles = np.concatenate([np.zeros(N_ROOT), mean[N_ROOT:]])
    roots = upright_roots(skeleton, views, angles)
    return np.hstack([roots, np.tile(angles[N_ROOT:], (len(roots), 1))])


def upright_roots(skeleton: Skeleton, views: Sequence[Keypoints], pose: FloatArray) -> FloatArray:
    """Return roots (N_HEADINGS, 6) with regularly spaced headings, at which a pose (P,) has the size and centre of the
    keypoints in the image of the view with most of them."""
    largest_view = max(views, key=lambda keypoints: len(keypoints.joints))
    roots = np.zeros((N_HEADINGS, N_ROOT))
    roots[:, 3] = np.arange(N_HEADINGS) * 2.0 * np.pi / N_HEADINGS
    for root in roots:
        root[:3] = _root_position(skeleton, largest_view, np.concatenate([root, pose[N_ROOT:]]))
    return roots


def _root_position(skeleton: Skeleton, view: Keypoints, pose: FloatArray) -> FloatArray:
    """Return the root's position (3,), m, at which a pose at the origin has the size and centre of the keypoints."""
    camera, pixels, body = view.camera, view.detections[:, :2], joints(skeleton, pose[None])[0, view.joints]
    middle, focal = body.mean(axis=0), camera.matrix[1, 1]
    size = np.linalg.norm((body - middle) @ camera.rotation[:2].T)
    depth = focal * size / max(float(np.linalg.norm(pixels - pixels.mean(axis=0))), 1.0)
    ray = np.append((pixels.mean(axis=0) - camera.matrix[:2, 2]) / camera.matrix[[0, 1], [0, 1]], 1.0)
    return camera.rotation.T @ (depth * ray - camera.translation) - middle


def coarse_data(task: Task) -> FitData:
    """Return the residuals of the initial search: a subset of the points, and keypoints where a view has enough."""
    loss = START_LOSS if "points" in observed_kinds(task.observations) else KEYPOINT_LOSS
    return FitData([_coarse_residual(task, frame) for frame in task.observations], task.times_s, loss, task.smoothness)


def first_roots(task: Task, decoder: MotionDecoder) -> FloatArray:
    """Return candidate roots (n, 6) in the first frame with enough observations, by its keypoints, else by points."""
    keypoints = first_keypoints(task.observations)
    if not keypoints:
        return roots_from_points(task.skeleton, [frame.points for frame in task.observations], task.times_s)
    return likely_roots(decoder, keypoints, views_residual(task.skeleton, keypoints, task.sigma_px))


def first_pose(task: Task, prior: GaussianPrior | None) -> FloatArray:
    """Return an initial pose (P,) in that frame without a motion model. prior: over poses, see `likely_poses`. Raises
    InputError if points alone do not determine the heading."""
    keypoints = first_keypoints(task.observations)
    if not keypoints:
        roots = roots_from_points(task.skeleton, [frame.points for frame in task.observations], task.times_s)
        if len(roots) > 1:
            raise InputError("least squares: the person moves too little to determine the heading; set an initial pose")
        return np.concatenate([roots[0], np.zeros(len(task.skeleton.dof_names) - N_ROOT)])
    residual = views_residual(task.skeleton, keypoints, task.sigma_px)
    return likely_poses(task.skeleton, keypoints, residual, prior, 1)[0]


def _coarse_residual(task: Task, observed: Observed) -> ResidualFunction:
    points, keypoints = observed.points[:: max(1, len(observed.points) // START_POINTS)], enough_keypoints(observed)
    terms = [surface_residual(task.skeleton, task.surface, points, "distance", START_SIGMA_M)] * bool(len(points))
    terms += [views_residual(task.skeleton, keypoints, task.sigma_px)] * bool(keypoints)
    return stacked(terms)
