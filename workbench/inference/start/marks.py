"""The automatic start from marked joints: where a person is, which way they face, where in their cycle they are."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from workbench.arrays import FloatArray
from workbench.body.camera import Camera
from workbench.body.kinematics import joints
from workbench.body.skeleton import Skeleton
from workbench.core.frame import MarkedFrames
from workbench.core.motion_model import MotionModel
from workbench.core.observations import Keypoints, usable_keypoints
from workbench.core.smoothness import Smoothness
from workbench.errors import InputError
from workbench.inference.fit.decoding import MotionDecoder
from workbench.inference.fit.hypotheses import KEYPOINT_LOSS, LEAST_KEYPOINTS, likely_roots
from workbench.inference.fit.motion import fit_motion, fit_problem
from workbench.inference.fit.phase_grid import find_phase
from workbench.inference.fit.residuals import views_residual

MARK_SIGMA_PX = 4.0


@dataclass(frozen=True, eq=False)
class StartFit:
    """pose: (P,) in the first marked frame, with its phase, cycles, and heading, rad. error_px: root mean square
    distance to all marks, weighted. rate_hz: cycles a second, NaN where one frame alone is marked."""

    pose: FloatArray
    error_px: float
    phase: float
    heading: float
    rate_hz: float


def start_from_marks(model: MotionModel, skeleton: Skeleton, camera: Camera, marks: MarkedFrames) -> StartFit:
    """The cyclic motion of the model that fits the joints marked in all F frames, in one style.

    Least squares over coefficients, phases and roots, from several headings and phases; the lowest cost wins. Marks
    have a deviation of MARK_SIGMA_PX, over the root of their weight; left and right come with them.
    Raises InputError as `usable_marks` does.
    """
    seen = usable_marks(skeleton, camera, marks)
    residuals = [views_residual(skeleton, [one], MARK_SIGMA_PX) for one in seen]
    decoder = MotionDecoder(skeleton, model, np.zeros(len(skeleton.dof_names)))
    roots = likely_roots(decoder, seen[:1], residuals[0])
    states = find_phase(decoder, residuals, marks.times_s, KEYPOINT_LOSS, Smoothness(), roots)
    problem = fit_problem(decoder, residuals, marks.times_s, KEYPOINT_LOSS, Smoothness(), len(seen))
    states, _, _ = fit_motion(problem, states, tolerance=1e-6)
    poses, phases = decoder.poses(states), states[:, decoder.n_style]
    rate_hz = float((phases[-1] - phases[0]) / (marks.times_s[-1] - marks.times_s[0])) if len(seen) > 1 else np.nan
    return StartFit(poses[0], error_px(skeleton, seen, poses), float(phases[0] % 1.0), float(poses[0, 3]), rate_hz)


def usable_marks(skeleton: Skeleton, camera: Camera, marks: MarkedFrames) -> list[Keypoints]:
    """The joints marked in each of the F frames.

    Raises InputError when fewer than LEAST_KEYPOINTS joints are marked in a frame.
    """
    given = [usable_keypoints(skeleton, rows, camera) for rows in marks.keypoints]
    seen = [one for one in given if one is not None and len(one.joints) >= LEAST_KEYPOINTS]
    if len(seen) < len(given):
        fewest = min(0 if one is None else len(one.joints) for one in given)
        raise InputError(f"start marks: expected at least {LEAST_KEYPOINTS} marked joints in a frame, found {fewest}")
    return seen


def error_px(skeleton: Skeleton, seen: Sequence[Keypoints], poses: FloatArray) -> float:
    """Root mean square distance of the joints of poses (F, P) to the marks, weighted."""
    squares, weights = [], []
    for one, places in zip(seen, joints(skeleton, poses), strict=True):
        squares.append(((one.camera.project(places[one.joints]) - one.marks[:, :2]) ** 2).sum(axis=1))
        weights.append(one.marks[:, 2])
    return float(np.sqrt(np.average(np.concatenate(squares), weights=np.concatenate(weights))))
