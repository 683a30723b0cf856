"""The automatic start from 2-D joints: where a person is, which way they face, and where in their cycle they are."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from workbench.arrays import FloatArray
from workbench.body.camera import Camera
from workbench.body.kinematics import joints
from workbench.body.skeleton import N_ROOT, Skeleton
from workbench.datasets.frame import MarkedFrames
from workbench.errors import InputError
from workbench.inference.decoding import MotionDecoder, PoseDecoder
from workbench.inference.frame_fit import Gaussian, Smoothness, fit_frame
from workbench.inference.motion_fit import fit_motion, fit_problem
from workbench.inference.observed import Keypoints, Observed, usable_keypoints, views_residual
from workbench.inference.phase_grid import N_HEADINGS, N_PHASES, find_phase
from workbench.inference.residuals import Loss, Residual
from workbench.learning.activities import ActivityModel
from workbench.learning.cycles import ANGLES, CHANNEL_NAMES
from workbench.learning.walking import WalkingModel
from workbench.priors.cyclic import Cyclic

MARK_SIGMA_PX = 4.0
LEAST_KEYPOINTS = 4
"""In one view of a frame to start from, which has six numbers of a root and a phase to tell."""
KEYPOINT_LOSS = Loss("huber", 3.0)
"""With which a start is found in keypoints: it sees any distance, since which joint is which is known."""
N_KEPT = 2
APART_M = 0.1
_APART_RAD = np.pi / 4.0  # between headings that are worth keeping both


@dataclass(frozen=True, eq=False)
class StartFit:
    """pose: (P,) in the first marked frame, with its phase, cycles, and heading, rad. error_px: root mean square
    distance to all marks, weighted. rate_hz: cycles a second, NaN where one frame alone is marked."""

    pose: FloatArray
    error_px: float
    phase: float
    heading: float
    rate_hz: float


def start_from_marks(prior: Cyclic, skeleton: Skeleton, camera: Camera, marks: MarkedFrames) -> StartFit:
    """The walk of the prior that fits the joints marked in all F frames, in one style.

    Least squares over coefficients, phases and roots, from several headings and phases; the lowest cost wins. Marks
    have a deviation of MARK_SIGMA_PX, over the root of their weight; left and right come with them.
    Raises InputError when fewer than LEAST_KEYPOINTS joints are marked in a frame.
    """
    given = [usable_keypoints(skeleton, rows, camera) for rows in marks.keypoints]
    seen = [one for one in given if one is not None and len(one.joints) >= LEAST_KEYPOINTS]
    if len(seen) < len(given):
        fewest = min(0 if one is None else len(one.joints) for one in given)
        raise InputError(f"start marks: expected at least {LEAST_KEYPOINTS} marked joints in a frame, found {fewest}")
    residuals = [views_residual(skeleton, [one], MARK_SIGMA_PX) for one in seen]
    decoder = MotionDecoder(skeleton, motion_model(prior.model), np.zeros(len(skeleton.dof_names)))
    roots = likely_roots(decoder, seen[:1], residuals[0])
    states = find_phase(decoder, residuals, marks.times_s, KEYPOINT_LOSS, Smoothness(), roots)
    problem = fit_problem(decoder, residuals, marks.times_s, KEYPOINT_LOSS, Smoothness(), len(seen))
    states, _, _ = fit_motion(problem, states, tolerance=1e-6)
    poses, phases = decoder.poses(states), states[:, decoder.n_style]
    rate_hz = float((phases[-1] - phases[0]) / (marks.times_s[-1] - marks.times_s[0])) if len(seen) > 1 else np.nan
    return StartFit(poses[0], _error_px(skeleton, seen, poses), float(phases[0] % 1.0), float(poses[0, 3]), rate_hz)


def enough_keypoints(seen: Observed) -> tuple[Keypoints, ...]:
    """The frame's keypoints, where some view shows enough to start from."""
    return seen.keypoints if any(len(one.joints) >= LEAST_KEYPOINTS for one in seen.keypoints) else ()


def first_keypoints(seen: Sequence[Observed]) -> tuple[Keypoints, ...]:
    """Those of the first frame that shows enough to start from; none where points are what it shows.

    Raises InputError when no frame does.
    """
    for one in seen:
        if len(one.points) or enough_keypoints(one):
            return enough_keypoints(one)
    raise InputError(f"least squares: expected {LEAST_KEYPOINTS} keypoints in some frame to start from, found fewer")


def motion_model(model: WalkingModel) -> ActivityModel:
    """A cyclic model as a motion model of one activity, with cycles two deviations slower and faster as examples."""
    mean_hz, deviation_hz = model.cycle_rate_hz
    return ActivityModel(
        angles=CHANNEL_NAMES[ANGLES], mean=model.mean[:, ANGLES], components=model.components[:, :, ANGLES],
        scales=model.scales, explained=np.array([model.explained]), scores=np.zeros((3, len(model.scales))),
        activities=("cycle",) * 3, sources=("",) * 3,
        cycle_rate_hz=mean_hz + deviation_hz * np.array([-2.0, 0.0, 2.0]),
    )  # fmt: skip


def likely_roots(decoder: MotionDecoder, seen: Sequence[Keypoints], residual: Residual) -> FloatArray:
    """The likeliest roots (n ≤ N_KEPT, 6) in one frame of keypoints, in which the mean motion at some phase fits best.

    From N_HEADINGS headings; no two of those kept are within 45°.
    """
    free, own, fits = PoseDecoder(decoder.skeleton), np.arange(N_ROOT), []
    phases = np.arange(N_PHASES) / N_PHASES
    for pose in decoder.poses(decoder.states(np.zeros(decoder.n_style), phases, np.zeros(N_ROOT))):
        for root in upright_roots(decoder.skeleton, seen, pose):
            guess = np.concatenate([root, pose[N_ROOT:]])
            fits.append(fit_frame(free, residual, KEYPOINT_LOSS, guess, free=own, max_iterations=8, tolerance=1e-2))
    kept: list[FloatArray] = []
    for fit in sorted(fits, key=lambda fit: fit.costs[-1]):
        root = fit.x[:N_ROOT]
        apart = [abs((root[3] - other[3] + np.pi) % (2.0 * np.pi) - np.pi) for other in kept]
        if len(kept) < N_KEPT and all(angle > _APART_RAD for angle in apart):
            kept.append(root)
    return np.array(kept)


def likely_pose(
    skeleton: Skeleton, seen: Sequence[Keypoints], residual: Residual, prior: Gaussian | None
) -> FloatArray:
    """The pose (P,) that fits one frame of keypoints best, without a motion; prior: over poses, else of no lean only.

    Where no prior holds the angles, the damping of the search does.
    """
    pose: FloatArray = likely_poses(skeleton, seen, residual, prior, 1)[0]
    return pose


def likely_poses(
    skeleton: Skeleton, seen: Sequence[Keypoints], residual: Residual, prior: Gaussian | None, most: int
) -> FloatArray:
    """The poses (n ≤ most, P) that fit one frame of keypoints best, the best first: minima found from N_HEADINGS
    headings whose joints are APART_M or more from each other in the mean."""
    upright = np.zeros(len(skeleton.dof_names)) if prior is None else prior.mean.copy()
    upright[:N_ROOT] = 0.0
    found = [
        fit_frame(PoseDecoder(skeleton), residual, KEYPOINT_LOSS, np.concatenate([root, upright[N_ROOT:]]), prior=prior)
        for root in upright_roots(skeleton, seen, upright)
    ]
    kept: list[FloatArray] = []
    for fit in sorted(found, key=lambda fit: fit.costs[-1]):
        places = joints(skeleton, np.stack([fit.x, *kept]))
        if len(kept) < most and (np.linalg.norm(places[1:] - places[0], axis=2).mean(axis=1) > APART_M).all():
            kept.append(fit.x)
    return np.array(kept)


def upright_roots(skeleton: Skeleton, seen: Sequence[Keypoints], pose: FloatArray) -> FloatArray:
    """Roots (N_HEADINGS, 6) all around, placed so that a pose (P,) has the keypoints' size and middle in the image of
    the view that shows most of them."""
    fullest = max(seen, key=lambda one: len(one.joints))
    roots = np.zeros((N_HEADINGS, N_ROOT))
    roots[:, 3] = np.arange(N_HEADINGS) * 2.0 * np.pi / N_HEADINGS
    for root in roots:
        root[:3] = _place(skeleton, fullest, np.concatenate([root, pose[N_ROOT:]]))
    return roots


def _place(skeleton: Skeleton, seen: Keypoints, pose: FloatArray) -> FloatArray:
    """Where (3,), m, the root of a pose at the origin has to go."""
    camera, pixels, body = seen.camera, seen.marks[:, :2], joints(skeleton, pose[None])[0, seen.joints]
    middle, focal = body.mean(axis=0), camera.matrix[1, 1]
    spread = np.linalg.norm((body - middle) @ camera.rotation[:2].T)
    depth = focal * spread / max(float(np.linalg.norm(pixels - pixels.mean(axis=0))), 1.0)
    ray = np.append((pixels.mean(axis=0) - camera.matrix[:2, 2]) / camera.matrix[[0, 1], [0, 1]], 1.0)
    place: FloatArray = camera.rotation.T @ (depth * ray - camera.translation) - middle
    return place


def _error_px(skeleton: Skeleton, seen: list[Keypoints], poses: FloatArray) -> float:
    """Root mean square distance of the joints of poses (F, P) to the marks, weighted."""
    squares, weights = [], []
    for one, places in zip(seen, joints(skeleton, poses), strict=True):
        squares.append(((one.camera.project(places[one.joints]) - one.marks[:, :2]) ** 2).sum(axis=1))
        weights.append(one.marks[:, 2])
    return float(np.sqrt(np.average(np.concatenate(squares), weights=np.concatenate(weights))))
