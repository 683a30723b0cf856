"""Angles of poses: whole turns, which change the numbers but not the pose, left and right, and flexions."""

from collections.abc import Mapping
from typing import Any

import numpy as np

from workbench.body.skeleton import POSE_NAMES, Skeleton
from workbench.utils.arrays import FloatArray
from workbench.utils.kernel_cache import kernel

N_POSITION = 3
"""Numbers of a pose that are lengths, which come first; all others are angles."""
_OTHER = {"left": "right", "right": "left"}
_SOURCES = np.array(
    [
        POSE_NAMES.index(f"{_OTHER[side]}_{angle}") if side in _OTHER else i
        for i, (side, _, angle) in enumerate(name.partition("_") for name in POSE_NAMES)
    ]
)
_ACROSS = ("root_y", "root_heading", "root_roll", "neck_turn", "neck_tilt")
_SIGNS = np.where(np.isin(POSE_NAMES, _ACROSS), -1.0, 1.0)
FLEXIONS: Mapping[str, Mapping[str, float]] = {
    "left_hip": {"left_hip_flexion": 1.0, "UpperLeg_L_y": -1.0, "lfemur_y": -1.0},
    "right_hip": {"right_hip_flexion": 1.0, "UpperLeg_R_y": -1.0, "rfemur_y": -1.0},
    "left_knee": {"left_knee_flexion": 1.0, "LowerLeg_L_y": 1.0, "ltibia_y": 1.0},
    "right_knee": {"right_knee_flexion": 1.0, "LowerLeg_R_y": 1.0, "rtibia_y": 1.0},
}
"""The degree of freedom, and its sign, in the person's skeleton and in the full ones of Bandai's and CMU's files; by
these flexions paper D compares a fit with the truth (figs. 5 to 9)."""


def nearest_turn(poses: FloatArray, reference: FloatArray) -> FloatArray:
    """Move every angle of poses (P,) or (N, P) by whole turns to within half a turn of that of `reference` (P,)."""
    middle = reference[N_POSITION:]
    if not _far(np.atleast_2d(poses), reference).any():
        return poses  # as nearly always, and told faster
    turns = np.rint((poses[..., N_POSITION:] - middle) / (2.0 * np.pi))
    moved = poses.copy()
    moved[..., N_POSITION:] -= 2.0 * np.pi * turns
    return moved


@kernel()
def _far(poses: Any, reference: Any) -> Any:
    """Count the poses (N, P) of which a number (P,) is an angle that is not within half a turn of the reference's.
    NumPy's maximum over so many short rows takes ten times as long."""
    far = np.zeros(reference.shape[0])
    for i in range(poses.shape[0]):
        for p in range(N_POSITION, reference.shape[0]):
            far[p] += 0.0 if abs(poses[i, p] - reference[p]) <= np.pi else 1.0
    return far


def wrapped(angles: FloatArray) -> FloatArray:
    """Take whole turns off angles, rad, of any shape: they come to lie in [−π, π)."""
    return (angles + np.pi) % (2.0 * np.pi) - np.pi


def exchanged(poses: FloatArray) -> FloatArray:
    """Exchange the joint angles of left and right in poses (..., P), the root staying where it is; any other number of
    parameters than a person's 25 stays as it is."""
    return poses[..., _SOURCES] if poses.shape[-1] == len(POSE_NAMES) else poses


def mirror_image(poses: FloatArray) -> FloatArray:
    """Return a person's poses (..., 25) as a mirror in the world's plane y = 0 shows them."""
    return np.asarray(_SIGNS * poses[..., _SOURCES])


def flexions(skeleton: Skeleton, pose: FloatArray) -> dict[str, float]:
    """Degrees, from −180 to 180, of those flexions of hips and knees that a skeleton has, in a pose (P,)."""
    return {
        name: wrapped_deg(sign * float(np.degrees(pose[skeleton.dof(dof)])))
        for name, signs in FLEXIONS.items()
        for dof, sign in signs.items()
        if dof in skeleton.dof_names
    }


def wrapped_deg(angle: float) -> float:
    """Wrap an angle, degrees, into −180 to 180."""
    return (angle + 180.0) % 360.0 - 180.0
