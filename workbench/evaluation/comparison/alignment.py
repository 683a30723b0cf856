"""Alignment of an estimated motion with a true one, in time and in space."""

from dataclasses import replace
from itertools import combinations
from typing import NamedTuple

import numpy as np

from workbench.evaluation.comparison.joint_motion import JointMotion
from workbench.evaluation.errors.pose_errors import best_rotation
from workbench.utils.arrays import FloatArray
from workbench.utils.nan_statistics import nan_mean

NONE, ROOT, RIGID, SIMILARITY = "none", "root", "rigid", "similarity"
ALIGNMENTS = (NONE, ROOT, RIGID, SIMILARITY)
"""In space: as they are; the pelvis of every frame in one place; one rotation and translation for all frames; one
rotation, translation and scale for all frames."""
MAX_OFFSET_S = 2.0
"""Largest offset of the clocks that is searched."""
MIN_GAIN = 0.25
"""Smallest relative reduction of the distance by an offset that is accepted, as in `detections.synchronization`."""
_MIN_OVERLAP = 0.5
"""Of the shorter motion, which is compared at an offset."""
_AS_GOOD = 1.1
"""Times the smallest difference: the offset of another cycle of a walk agrees as well but for the noise."""
_SAME_MINIMUM_S = 0.1
"""Offsets nearer to each other belong to one minimum, which is wider in slower motion."""
_MOST_FRAMES = 400
_ON_GRID = 0.1
"""Of a frame: an offset nearer to a whole number of frames, of two motions of one rate, is that number."""


class Similarity(NamedTuple):
    """x → scale · rotation x + translation. rotation: (3, 3). translation: (3,), m."""

    scale: float
    rotation: FloatArray
    translation: FloatArray

    def __call__(self, points: FloatArray) -> FloatArray:
        """Return transformed points (..., 3), m."""
        return self.scale * points @ self.rotation.T + self.translation

    @property
    def angle_deg(self) -> float:
        """Return the angle of the rotation, degrees."""
        return float(np.degrees(np.arccos(np.clip(0.5 * (np.trace(self.rotation) - 1.0), -1.0, 1.0))))


def similarity(estimate: FloatArray, truth: FloatArray, scaled: bool) -> Similarity | None:
    """Return the least-squares transformation of points (..., 3), m, of the estimate to the truth's (Umeyama 1991).

    Its scale is 1 unless `scaled`. None for fewer than three known points.
    """
    known = np.isfinite(estimate).all(axis=-1) & np.isfinite(truth).all(axis=-1)
    if known.sum() < 3:
        return None
    own, true = estimate[known], truth[known]
    own_mean, true_mean = own.mean(axis=0), true.mean(axis=0)
    size = float(np.square(own - own_mean).sum())
    rotation, stretched = best_rotation(own - own_mean, true - true_mean)
    scale = stretched / size if scaled and size > 0.0 else 1.0
    return Similarity(scale, rotation, true_mean - scale * rotation @ own_mean)


def offset_s(estimate: JointMotion, truth: JointMotion) -> float:
    """Return the time, s, to add to the estimate's clock, up to MAX_OFFSET_S; 0 if none is clearly better.

    Distances between pairs of joints, less their means, depend neither on axes and places nor on the definitions of
    joints. The offset at which they agree best is accepted if their difference (root mean square) is smaller by
    MIN_GAIN than without. Of offsets nearly as good it is the smallest, as a walk repeats itself. Both motions have
    the same joints.
    """
    own, step_s = _subset(estimate), min(estimate.interval_s, truth.interval_s)
    if not np.isfinite(step_s) or len(own.names) < 3:
        return 0.0
    reach = int(min(MAX_OFFSET_S, 0.5 * np.ptp(estimate.times_s), 0.5 * np.ptp(truth.times_s)) / step_s)
    offsets = step_s * np.arange(-reach, reach + 1)
    costs = np.array([_difference(own, truth, each) for each in offsets])
    zero = float(costs[reach])
    if not np.isfinite(costs).any():
        return 0.0
    good = np.flatnonzero(costs <= _AS_GOOD * np.nanmin(costs))
    nearest = int(good[np.argmin(np.abs(offsets[good]))])
    cycle = slice(max(nearest - round(_SAME_MINIMUM_S / step_s), 0), nearest + round(_SAME_MINIMUM_S / step_s) + 1)
    best = cycle.start + int(np.nanargmin(costs[cycle]))
    if np.isfinite(zero) and not costs[best] < (1.0 - MIN_GAIN) * zero:
        return 0.0
    offset = float(offsets[best])
    if 0 < best < len(costs) - 1 and np.isfinite(costs[best - 1 : best + 2]).all():
        before, at, after = np.square(costs[best - 1 : best + 2])
        shift = 0.5 * (before - after) / max(before - 2.0 * at + after, 1e-12)
        same_rate = abs(estimate.interval_s / truth.interval_s - 1.0) < 1e-3
        offset += step_s * shift if not same_rate or abs(shift) > _ON_GRID else 0.0
    return offset


def _subset(motion: JointMotion) -> JointMotion:
    """Return _MOST_FRAMES of a motion's frames, at equal intervals."""
    rows = np.unique(np.linspace(0, len(motion.times_s) - 1, _MOST_FRAMES).astype(int))
    return replace(
        motion, times_s=motion.times_s[rows], positions=motion.positions[rows], samples=motion.samples[:, rows]
    )


def _difference(estimate: JointMotion, truth: JointMotion, offset: float) -> float:
    """Return the root mean square difference, m, of distances between joints at an offset; NaN with little overlap."""
    true = truth.at(estimate.times_s + offset)
    pairs = np.array([*combinations(range(len(estimate.names)), 2)]).T
    own, other = (
        np.linalg.norm(each.positions[:, pairs[0]] - each.positions[:, pairs[1]], axis=-1) for each in (estimate, true)
    )
    difference = own - other
    known = np.isfinite(difference)
    inside = known.any(axis=1).sum()
    span = min(len(estimate.times_s), np.ptp(truth.times_s) / max(estimate.interval_s, 1e-9))
    if inside < max(_MIN_OVERLAP * span, 2.0):
        return np.nan
    return float(np.sqrt(np.square(difference - nan_mean(difference, axis=0))[known].mean()))


def aligned(estimate: JointMotion, truth: JointMotion, kind: str) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return the positions (F, J, 3), m, of both and the samples (S, F, J, 3) of the estimate, aligned by a kind of
    ALIGNMENTS, each sample by itself; both have the same joints and times, and the pelvis for ROOT."""
    own, true, samples = estimate.positions, truth.positions, estimate.samples
    if kind == ROOT:
        root = [estimate.names.index("pelvis")]
        return own - own[:, root], true - true[:, root], samples - samples[:, :, root]
    if kind == NONE:
        return own, true, samples
    moved = [own, *samples]
    for k, each in enumerate(moved):
        transform = similarity(each, true, scaled=kind == SIMILARITY)
        moved[k] = each if transform is None else transform(each)
    return moved[0], true, np.array(moved[1:]).reshape(samples.shape)
