"""Initial roots and poses of a person from the 2-D joints of one frame."""

from collections.abc import Sequence

import numpy as np

from workbench.body.kinematics import joints
from workbench.body.skeleton import N_ROOT, Skeleton
from workbench.core.losses import SEARCH_LOSS
from workbench.core.observations import Keypoints, Observed
from workbench.core.residual import ResidualFunction
from workbench.inference.least_squares.solver.single_frame import GaussianPrior, PoseDecoder, fit_frame
from workbench.utils.arrays import FloatArray
from workbench.utils.errors import InputError

MIN_KEYPOINTS = 4
"""In one view of the first frame, to determine the six parameters of the root and a phase."""
N_HEADINGS = 8
MIN_SEPARATION_M = 0.1


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
    fits = [fit_frame(PoseDecoder(skeleton), residual, SEARCH_LOSS, pose, prior=prior) for pose in upright]
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
