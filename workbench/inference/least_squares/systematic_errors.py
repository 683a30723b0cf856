"""Errors that many observations share, which more of them do not average out: of points, limb lengths, detectors."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from workbench.body.kinematics import forward
from workbench.body.skeleton import Skeleton
from workbench.body.surface import Surface, attach
from workbench.core.observations import Observed
from workbench.core.residual import keypoint_residual
from workbench.utils.arrays import FloatArray, IntArray

N_POSITION = 3


@dataclass(frozen=True, eq=False)
class Shared:
    """Displacements d of the points of each part of the body, and of all points, in every frame the same:

        x_tk = surface + noise + d_part(k) + d_all,  d ~ N(0, sigma_m² I)

    A part is off where the person's proportions, flesh or clothes are others than told; all are where the camera is.
    part: frame by frame, from a pose (P,) to the parts (K,) of its points. n_parts: of the body.
    """

    sigma_m: float
    part: Sequence[Callable[[FloatArray], IntArray]]
    n_parts: int

    @staticmethod
    def of_points(skeleton: Skeleton, surface: Surface, seen: Sequence[Observed], sigma_m: float) -> "Shared":
        """Share errors among the points that are nearest to one part of the surface."""

        def parts_of(points: FloatArray) -> Callable[[FloatArray], IntArray]:
            return lambda pose: attach(surface, forward(skeleton, pose[None]), points)

        return Shared(sigma_m, [parts_of(frame.points) for frame in seen], len(surface.part_names))

    def shifts(self, t: int, slopes: FloatArray, pose: FloatArray) -> FloatArray:
        """Return by how much one deviation of each displacement changes the residuals of frame t at a pose (P,), (K, 3
        parts + 3). slopes: (K, P), of the residuals; points that move are a root that moves the other way."""
        parts = self.part[t](pose)
        moved = -self.sigma_m * slopes[: len(parts), :N_POSITION]  # points come first
        found = np.zeros((len(slopes), self.n_parts + 1, N_POSITION))
        found[np.arange(len(parts)), parts] = moved
        found[: len(parts), -1] = moved
        return found.reshape(len(slopes), N_POSITION * (self.n_parts + 1))


TOLD_SIGMA = 0.02
"""Of a bone over its length, where its accuracy is not given: what a measuring tape leaves."""


def told_doubt(skeleton: Skeleton) -> FloatArray:
    """Return the doubt (J, 3, G) of a skeleton whose bones are TOLD_SIGMA of their length off, both sides alike."""
    bones = [name.removeprefix("left_").removeprefix("right_") for name in skeleton.names]
    causes = list(dict.fromkeys(bones))
    own = np.array([[bone == cause for cause in causes] for bone in bones], dtype=np.float64)
    return np.asarray(TOLD_SIGMA * skeleton.offsets[:, :, None] * own[:, None, :])


MOST_APART_S = 0.1
"""Frames further apart are not compared."""
FAR = 4.0
LEAST_PAIRS = 100
"""Errors to compare; fewer tell nothing."""


def error_correlation(
    skeleton: Skeleton, seen: Sequence[Observed], times_s: FloatArray, poses: FloatArray, sigma_px: float
) -> float:
    """Estimate the correlation ρ between a joint's errors in frames that follow each other, at poses (T, P).

    Errors beyond FAR robust deviations, of joints that were taken for others, are left out. Zero where it is within two
    standard errors of none, 1 / √n for n pairs, and where there are too few pairs.
    """
    residuals = [_errors(skeleton, frame, pose, sigma_px) for frame, pose in zip(seen, poses, strict=True)]
    pairs = [
        (first[mark], then[mark])
        for (first, then), gap in zip(pairwise(residuals), np.diff(times_s), strict=True)
        if gap <= MOST_APART_S
        for mark in first
        if mark in then
    ]
    before, after = np.array(pairs).reshape(-1, 2, 2).transpose(1, 0, 2)
    if before.size < LEAST_PAIRS:
        return 0.0
    far = FAR * 1.4826 * float(np.median(np.abs(before)))
    near = (np.abs(before) < far) & (np.abs(after) < far)
    before, after = before[near], after[near]
    rho = float((before * after).sum() / np.sqrt((before**2).sum() * (after**2).sum()))
    return rho if rho > 2.0 / np.sqrt(before.size) else 0.0


def effective_share(rho: float) -> float:
    """Return what part of the frames counts, (1 − ρ) / (1 + ρ): as many independent ones determine a mean as well as
    many whose errors are a first-order autoregression with correlation ρ."""
    return (1.0 - rho) / (1.0 + rho)


def _errors(
    skeleton: Skeleton, frame: Observed, pose: FloatArray, sigma_px: float
) -> dict[tuple[str, int], FloatArray]:
    """Give the whitened errors (2,) of one frame's joints in each view, by camera and joint."""
    errors: dict[tuple[str, int], FloatArray] = {}
    for view in frame.keypoints:
        misses, _ = keypoint_residual(skeleton, view.camera, view.joints, view.marks, sigma_px)(pose)
        rows = misses.reshape(-1, 2)
        errors |= {(view.camera.name, int(joint)): error for joint, error in zip(view.joints, rows, strict=True)}
    return errors
