"""Angles of poses: unwrapping, left–right swaps and mirror images, and flexions."""

from collections.abc import Mapping, Sequence
from functools import lru_cache
from typing import Any

import numpy as np

from workbench.body.skeleton import POSE_NAMES, POSE_NAMES_WITH_FEET, Skeleton
from workbench.utils.arrays import FloatArray, IntArray
from workbench.utils.kernel_cache import kernel

N_POSITION = 3
"""Number of lengths of a pose, which precede the angles."""
_OPPOSITE = {"left": "right", "right": "left"}
_ANTISYMMETRIC = ("root_y", "root_heading", "root_roll", "neck_turn", "neck_tilt")


def _mirrored(names: Sequence[str]) -> IntArray:
    """Return the column (P,) of the other side's number for each number of a pose."""
    sides = [name.partition("_") for name in names]
    return np.array([names.index(f"{_OPPOSITE[s]}_{n}") if s in _OPPOSITE else i for i, (s, _, n) in enumerate(sides)])


_MIRRORED_INDEX = {len(names): _mirrored(names) for names in (POSE_NAMES, POSE_NAMES_WITH_FEET)}
_MIRROR_SIGNS = np.where(np.isin(POSE_NAMES_WITH_FEET, _ANTISYMMETRIC), -1.0, 1.0)
FLEXIONS: Mapping[str, Mapping[str, float]] = {
    "left_hip": {"left_hip_flexion": 1.0, "UpperLeg_L_y": -1.0, "lfemur_y": -1.0},
    "right_hip": {"right_hip_flexion": 1.0, "UpperLeg_R_y": -1.0, "rfemur_y": -1.0},
    "left_knee": {"left_knee_flexion": 1.0, "LowerLeg_L_y": 1.0, "ltibia_y": 1.0},
    "right_knee": {"right_knee_flexion": 1.0, "LowerLeg_R_y": 1.0, "rtibia_y": 1.0},
}
"""The degree of freedom of each flexion, and its sign, in the person's skeleton and in the full ones of Bandai's and
CMU's files; paper D compares fits with the truth by these (figs. 5 to 9)."""


def unwrap_near(poses: FloatArray, reference: FloatArray) -> FloatArray:
    """Return poses (P,) or (N, P) with whole turns added to angles, within half a turn of `reference` (P,)."""
    center = reference[N_POSITION:]
    if not _count_wrapped(np.atleast_2d(poses), reference).any():
        return poses  # the usual case, and a fast test
    turns = np.rint((poses[..., N_POSITION:] - center) / (2.0 * np.pi))
    unwrapped = poses.copy()
    unwrapped[..., N_POSITION:] -= 2.0 * np.pi * turns
    return unwrapped


@kernel()
def _count_wrapped(poses: Any, reference: Any) -> Any:
    """Return, for each number (P,), how many poses (N, P) have an angle farther than half a turn from the reference's.
    Ten times as fast as NumPy's maximum over short rows."""
    count = np.zeros(reference.shape[0])
    for i in range(poses.shape[0]):
        for p in range(N_POSITION, reference.shape[0]):
            count[p] += 0.0 if abs(poses[i, p] - reference[p]) <= np.pi else 1.0
    return count


def wrapped(angles: FloatArray) -> FloatArray:
    """Return angles, rad, of any shape, wrapped to [−π, π)."""
    return (angles + np.pi) % (2.0 * np.pi) - np.pi


def swap_left_right(poses: FloatArray) -> FloatArray:
    """Return poses (..., P) with the joint angles of left and right swapped and the root unchanged; unchanged if P is
    neither a person's 25 nor, with feet, 27."""
    index = _MIRRORED_INDEX.get(poses.shape[-1])
    return poses if index is None else poses[..., index]


def mirror_image(poses: FloatArray) -> FloatArray:
    """Return the mirror image of a person's poses (..., 25), or with feet (..., 27), in the world's plane y = 0."""
    n = poses.shape[-1]
    return np.asarray(_MIRROR_SIGNS[:n] * poses[..., _MIRRORED_INDEX[n]])


def flexions(skeleton: Skeleton, pose: FloatArray) -> dict[str, float]:
    """Return those flexions of hips and knees that a skeleton has, degrees, −180 to 180, in a pose (P,)."""
    found = _flexions(skeleton)
    degrees = np.degrees(pose[[dof for _, dof, _ in found]]).tolist()
    return {name: wrapped_deg(sign * angle) for (name, _, sign), angle in zip(found, degrees, strict=True)}


@lru_cache
def _flexions(skeleton: Skeleton) -> list[tuple[str, int, float]]:
    """Return name, degree of freedom and sign of the flexions that a skeleton has."""
    named = [(name, dof, sign) for name, signs in FLEXIONS.items() for dof, sign in signs.items()]
    return [(name, skeleton.dof(dof), sign) for name, dof, sign in named if dof in skeleton.dof_names]


def wrapped_deg(angle: float) -> float:
    """Return an angle, degrees, wrapped to −180 to 180."""
    return (angle + 180.0) % 360.0 - 180.0
