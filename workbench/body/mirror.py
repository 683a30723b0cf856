"""Left and right: poses in which they are exchanged, and mirror images."""

import numpy as np

from workbench.body.skeleton import POSE_NAMES
from workbench.utils.arrays import FloatArray

_OTHER = {"left": "right", "right": "left"}
_SOURCES = np.array(
    [
        POSE_NAMES.index(f"{_OTHER[side]}_{angle}") if side in _OTHER else i
        for i, (side, _, angle) in enumerate(name.partition("_") for name in POSE_NAMES)
    ]
)
_ACROSS = ("root_y", "root_heading", "root_roll", "neck_turn", "neck_tilt")
_SIGNS = np.where(np.isin(POSE_NAMES, _ACROSS), -1.0, 1.0)


def exchanged(poses: FloatArray) -> FloatArray:
    """Exchange the joint angles of left and right in poses (..., P), the root staying where it is; any other number of
    parameters than a person's 25 stays as it is."""
    return poses[..., _SOURCES] if poses.shape[-1] == len(POSE_NAMES) else poses


def mirror_image(poses: FloatArray) -> FloatArray:
    """Return a person's poses (..., 25) as a mirror in the world's plane y = 0 shows them."""
    return np.asarray(_SIGNS * poses[..., _SOURCES])
