"""What the studies of learning from walks have in common."""

import logging
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from workbench.body.skeleton import N_ROOT, POSE_NAMES
from workbench.motion.models.gaps import motion_period
from workbench.motion.models.training import training_motions
from workbench.motion.pose_sequence import Motion
from workbench.utils.arrays import FloatArray
from workbench.utils.errors import InputError

ANGLES = tuple(
    f"{side}_{angle}"
    for side in ("left", "right")
    for angle in ("hip_flexion", "knee_flexion", "shoulder_flexion", "elbow_flexion")
)
"""The joint angles shown: the left side's four, then the right side's."""

log = logging.getLogger(__name__)


@dataclass(frozen=True, kw_only=True)
class WalkStudy:
    """What every study of walks is told. motions, data, cache, subjects: as for `training_motions`."""

    motions: str = "builtin"
    data: str | None = None
    cache: str = "~/.cache/workbench"
    subjects: Sequence[str] | None = None

    def walks(self) -> tuple[Motion, ...]:
        """Return the motions to study, see `training_motions`; says which they are."""
        found = training_motions(self.motions, data=self.data, cache=self.cache, subjects=self.subjects)
        people = {motion.subject for motion in found}
        seconds = sum(len(motion) / motion.rate_hz for motion in found)
        log.info("motions: %d walks (%s) of %d people, %.0f s", len(found), self.motions, len(people), seconds)
        return found


def cyclic(motions: Sequence[Motion]) -> tuple[list[Motion], list[float]]:
    """Select the motions in which a period is found, and their periods in frames; the others are named in a warning.

    Raises InputError when none is left.
    """
    kept, periods = [], []
    for motion in motions:
        try:
            periods.append(motion_period(motion, motion.poses[:, N_ROOT:]))
            kept.append(motion)
        except InputError as error:
            log.warning("%s left out: %s", motion.name, error)
    if not kept:
        raise InputError(f"study: expected cyclic motions, found no period in any of {len(motions)}")
    return kept, periods


def angle(name: str) -> int:
    """Find where a joint angle stands among the 19."""
    return POSE_NAMES.index(name) - N_ROOT


def title(name: str) -> str:
    """Return a parameter's name as words."""
    return name.replace("_", " ")


def degrees(curves: Mapping[str, FloatArray]) -> dict[str, FloatArray]:
    """Return curves in rad as curves in degrees."""
    return {label: np.degrees(curve) for label, curve in curves.items()}


def closed(curve: FloatArray) -> FloatArray:
    """Close a curve (T,) over phases 0, 1/T, … with its first value again at phase 1."""
    return np.append(curve, curve[0])


def phases(n: int) -> FloatArray:
    """Return phases 0, 1/n, …, 1 (n + 1,) of a closed curve."""
    return np.linspace(0.0, 1.0, n + 1)
