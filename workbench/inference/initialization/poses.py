"""The poses that tracking starts from: given, or found in marks, detected joints or points, whatever the prior."""

from collections.abc import Iterable
from dataclasses import dataclass
from itertools import takewhile

import numpy as np

from workbench.body.camera import Camera
from workbench.body.limbs import Body
from workbench.body.skeleton import Skeleton
from workbench.body.surface import Surface, person_surface
from workbench.core.frame import Frame, MarkedFrames
from workbench.core.frame_cache import FrameCache
from workbench.core.observations import Observables, Observed
from workbench.core.prior import Powers, Prior
from workbench.core.residual import Loss, ResidualFunction, surface_residual
from workbench.inference.initialization.from_annotations import (
    error_px,
    start_from_examples,
    start_from_marks,
    usable_marks,
)
from workbench.inference.initialization.from_keypoints import START_S, allowed_poses, start_from_keypoints
from workbench.inference.least_squares.hypotheses import START_LOSS, START_SIGMA_M
from workbench.inference.least_squares.least_squares import LeastSquares
from workbench.utils.arrays import FloatArray
from workbench.utils.errors import InputError

POINTS_S = 1.0
"""Time whose frames are looked at: which way a person faces shows in which way they go."""


@dataclass(frozen=True, eq=False)
class Distances:
    """Distances of points from a surface, as the start of least squares always looks at them."""

    skeleton: Skeleton
    surface: Surface
    observables: Observables = Observables(sigma=START_SIGMA_M)  # noqa: RUF009 - frozen
    residual_loss: Loss = START_LOSS

    def residual(self, observed: Observed) -> ResidualFunction:
        """Measure the distances, whitened by the deviation."""
        return surface_residual(self.skeleton, self.surface, observed.points, "distance", START_SIGMA_M)


def start_from_points(prior: Prior | None, body: Body, frames: Iterable[Frame]) -> FloatArray:
    """Find the pose (P,) in the first frame that the points of the first second tell.

    The prior's motion model is fitted where it has one, else smooth poses within the body's limits. Raises InputError
    where the points do not tell where the person faces.
    """
    frames = iter(frames)
    first = next(frames)
    seen = [first, *takewhile(lambda frame: frame.time_s - first.time_s <= POINTS_S, frames)]
    distances = Distances(body.skeleton, person_surface(body))
    fit, _, _ = LeastSquares(body, distances, prior).fit_frames(seen, None, np.random.default_rng(0))
    return fit.poses[0]


def start_poses(prior: Prior | None, body: Body, clip: FrameCache) -> tuple[FloatArray, str]:
    """Find the pose (P,) in the first frame, or several (n, P) of which each may be it, and say in a sentence how.

    The prior's own first pose comes first, then the dataset's, for which there is nothing to say; then marked joints,
    by what the prior knows of people: a cyclic motion, examples, or nothing, where the body's limits have to do; then
    detected joints, then points. Raises InputError where there is none of these, or too few joints.
    """
    known, powers = clip.known, Powers() if prior is None else prior.powers
    if powers.first_pose is not None:
        return powers.first_pose(), ""
    if known.start_pose is not None:
        return known.start_pose, ""
    if known.start_marks is not None:
        poses, how = _from_marks(powers, body.skeleton, known.cameras[0], known.start_marks, known.scale)
        return poses, f"start fitted to the marks: {how}"
    if known.has_keypoints:
        poses = start_from_keypoints(body.skeleton, clip)
        return poses, f"start fitted to keypoints: {len(poses)} poses that they allow"
    if known.has_points:
        return start_from_points(prior, body, clip), "start fitted to the points of the first second"
    raise InputError(
        "dataset: no starting pose: mark joints of the first frame of a video (dataset.start_marks=FILE.csv), give "
        "the start of points (dataset.start=given), or fit by inference=least_squares, which finds it"
    )


def _from_marks(
    powers: Powers, skeleton: Skeleton, camera: Camera, marks: MarkedFrames, scale: float
) -> tuple[FloatArray, str]:
    """Find the pose (P,) or poses (n, P) that fit the marks, and say how well, in pixels of the source's images."""
    if powers.motion is not None:
        fit = start_from_marks(powers.motion, skeleton, camera, marks)
        pace = "" if np.isnan(fit.rate_hz) else f", {fit.rate_hz:.2f} cycles/s"
        error, heading = fit.error_px / scale, np.degrees(fit.heading)
        return fit.pose, f"residual {error:.1f} px, phase {fit.phase:.2f}, heading {heading:.0f}°{pace}"
    seen = usable_marks(skeleton, camera, marks)
    if powers.examples is not None:
        poses, of = start_from_examples(powers.examples(), skeleton, seen[0]), "the prior's examples"
    else:
        soon = np.flatnonzero(marks.times_s - marks.times_s[0] <= START_S)
        poses = allowed_poses(skeleton, [(seen[k],) for k in soon], marks.times_s[soon])
        of = "the poses that they allow"
    error = error_px(skeleton, seen[:1], poses[:1]) / scale
    return poses, f"residual {error:.1f} px by the best of {len(poses)} of {of}"
