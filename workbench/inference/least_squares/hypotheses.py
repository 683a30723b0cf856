"""Where a person may be who is seen in one frame's 2-D joints, and how they may stand."""

from collections.abc import Sequence

import numpy as np

from workbench.body.angles import wrapped
from workbench.body.kinematics import joints
from workbench.body.skeleton import N_ROOT, Skeleton
from workbench.core.observations import Keypoints, Observed, observed_kinds
from workbench.core.residual import Loss, ResidualFunction, stacked, surface_residual
from workbench.inference.least_squares.phase_grid import N_HEADINGS, N_PHASES, roots_from_points
from workbench.inference.least_squares.residuals import views_residual
from workbench.inference.least_squares.single_frame import FitData, GaussianPrior, MotionDecoder, PoseDecoder, fit_frame
from workbench.inference.least_squares.task import Task
from workbench.utils.arrays import FloatArray
from workbench.utils.errors import InputError

LEAST_KEYPOINTS = 4
"""In one view of a frame to start from, which has six numbers of a root and a phase to tell."""
KEYPOINT_LOSS = Loss("huber", 3.0)
"""With which a start is found in keypoints: it sees any distance, since which joint is which is known."""
N_KEPT = 2
APART_M = 0.1
_APART_RAD = np.pi / 4.0  # between headings that are worth keeping both
START_POINTS = 150
"""Points a frame that the start looks at, taken evenly from all; more only make it slower."""
START_SIGMA_M = 0.02
START_LOSS = Loss("geman_mcclure", 1.5)
"""The start always looks at distances with this deviation and loss: the field says nothing far from the body."""


def enough_keypoints(seen: Observed) -> tuple[Keypoints, ...]:
    """Return the frame's keypoints, where some view shows enough to start from."""
    return seen.keypoints if any(len(view.joints) >= LEAST_KEYPOINTS for view in seen.keypoints) else ()


def first_keypoints(seen: Sequence[Observed]) -> tuple[Keypoints, ...]:
    """Select those of the first frame that shows enough to start from, points or keypoints; raises InputError if none
    does."""
    for frame in seen:
        if len(frame.points) or enough_keypoints(frame):
            return enough_keypoints(frame)
    raise InputError(f"least squares: expected {LEAST_KEYPOINTS} keypoints in some frame to start from, found fewer")


def likely_roots(decoder: MotionDecoder, seen: Sequence[Keypoints], residual: ResidualFunction) -> FloatArray:
    """Return the likeliest roots (n ≤ N_KEPT, 6) in one frame of keypoints, in which the mean motion at some phase fits
    best. From N_HEADINGS headings; no two of those kept are within 45°."""
    free, own, fits = PoseDecoder(decoder.skeleton), np.arange(N_ROOT), []
    phases = np.arange(N_PHASES) / N_PHASES
    for pose in decoder.poses(decoder.states(np.zeros(decoder.n_style), phases, np.zeros(N_ROOT))):
        for root in upright_roots(decoder.skeleton, seen, pose):
            guess = np.concatenate([root, pose[N_ROOT:]])
            fits.append(fit_frame(free, residual, KEYPOINT_LOSS, guess, free=own, max_iterations=8, tolerance=1e-2))
    kept: list[FloatArray] = []
    for fit in sorted(fits, key=lambda fit: fit.costs[-1]):
        root = fit.x[:N_ROOT]
        apart = [abs(wrapped(root[3] - other[3])) for other in kept]
        if len(kept) < N_KEPT and all(angle > _APART_RAD for angle in apart):
            kept.append(root)
    return np.array(kept)


def likely_poses(
    skeleton: Skeleton, seen: Sequence[Keypoints], residual: ResidualFunction, prior: GaussianPrior | None, most: int
) -> FloatArray:
    """Find the poses (n ≤ most, P) that fit one frame of keypoints best without a motion, the best first: minima found
    from N_HEADINGS headings whose joints are APART_M or more from each other in the mean. prior: over poses, else of no
    lean only; where none holds the angles, the damping of the search does."""
    upright = upright_poses(skeleton, seen, np.zeros(len(skeleton.dof_names)) if prior is None else prior.mean)
    fits = [fit_frame(PoseDecoder(skeleton), residual, KEYPOINT_LOSS, pose, prior=prior) for pose in upright]
    fits.sort(key=lambda fit: fit.costs[-1])
    return distinct_poses(skeleton, np.array([fit.x for fit in fits]), most, APART_M)


def distinct_poses(skeleton: Skeleton, poses: FloatArray, most: int, apart_m: float) -> FloatArray:
    """Select the first, at most so many, of poses (k, P) whose joints are that far or more from those of all before."""
    places, kept = joints(skeleton, poses), np.empty(0, dtype=np.intp)
    for k in range(len(poses)):
        distances = np.linalg.norm(places[kept] - places[k], axis=2).mean(axis=1)
        if len(kept) < most and (distances > apart_m).all():
            kept = np.append(kept, k)
    return poses[kept]


def upright_poses(skeleton: Skeleton, seen: Sequence[Keypoints], mean: FloatArray) -> FloatArray:
    """Return poses (N_HEADINGS, P) all around, with the angles of `mean` (P,) and no lean, placed as
    `upright_roots`."""
    angles = np.concatenate([np.zeros(N_ROOT), mean[N_ROOT:]])
    roots = upright_roots(skeleton, seen, angles)
    return np.hstack([roots, np.tile(angles[N_ROOT:], (len(roots), 1))])


def upright_roots(skeleton: Skeleton, seen: Sequence[Keypoints], pose: FloatArray) -> FloatArray:
    """Return roots (N_HEADINGS, 6) all around, placed so that a pose (P,) has the keypoints' size and middle in the
    image of the view that shows most of them."""
    fullest = max(seen, key=lambda keypoints: len(keypoints.joints))
    roots = np.zeros((N_HEADINGS, N_ROOT))
    roots[:, 3] = np.arange(N_HEADINGS) * 2.0 * np.pi / N_HEADINGS
    for root in roots:
        root[:3] = _place(skeleton, fullest, np.concatenate([root, pose[N_ROOT:]]))
    return roots


def _place(skeleton: Skeleton, seen: Keypoints, pose: FloatArray) -> FloatArray:
    """Find where (3,), m, the root of a pose at the origin has to go."""
    camera, pixels, body = seen.camera, seen.marks[:, :2], joints(skeleton, pose[None])[0, seen.joints]
    middle, focal = body.mean(axis=0), camera.matrix[1, 1]
    spread = np.linalg.norm((body - middle) @ camera.rotation[:2].T)
    depth = focal * spread / max(float(np.linalg.norm(pixels - pixels.mean(axis=0))), 1.0)
    ray = np.append((pixels.mean(axis=0) - camera.matrix[:2, 2]) / camera.matrix[[0, 1], [0, 1]], 1.0)
    return camera.rotation.T @ (depth * ray - camera.translation) - middle


def coarse_data(task: Task) -> FitData:
    """Make what the start looks at: some of the points, and keypoints where there are enough."""
    loss = START_LOSS if "points" in observed_kinds(task.seen) else KEYPOINT_LOSS
    return FitData([_coarse(task, frame) for frame in task.seen], task.times_s, loss, task.smoothness)


def first_roots(task: Task, decoder: MotionDecoder) -> FloatArray:
    """Find where the person may be, (n, 6), in the first frame that shows enough: by its keypoints, else by points."""
    keypoints = first_keypoints(task.seen)
    if not keypoints:
        return roots_from_points(task.skeleton, [frame.points for frame in task.seen], task.times_s)
    return likely_roots(decoder, keypoints, views_residual(task.skeleton, keypoints, task.sigma_px))


def first_pose(task: Task, prior: GaussianPrior | None) -> FloatArray:
    """Find a pose (P,) of the person there without a motion model; prior: over poses, see `likely_poses`. Raises
    InputError where points alone are seen and do not tell where the person faces."""
    keypoints = first_keypoints(task.seen)
    if not keypoints:
        roots = roots_from_points(task.skeleton, [frame.points for frame in task.seen], task.times_s)
        if len(roots) > 1:
            raise InputError("least squares: the person moves too little to tell where they face; give a start")
        return np.concatenate([roots[0], np.zeros(len(task.skeleton.dof_names) - N_ROOT)])
    residual = views_residual(task.skeleton, keypoints, task.sigma_px)
    return likely_poses(task.skeleton, keypoints, residual, prior, 1)[0]


def _coarse(task: Task, seen: Observed) -> ResidualFunction:
    points, keypoints = seen.points[:: max(1, len(seen.points) // START_POINTS)], enough_keypoints(seen)
    parts = [surface_residual(task.skeleton, task.surface, points, "distance", START_SIGMA_M)] * bool(len(points))
    parts += [views_residual(task.skeleton, keypoints, task.sigma_px)] * bool(keypoints)
    return stacked(parts)
