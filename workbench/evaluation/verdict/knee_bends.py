"""The directions in which knees bend, by positions of joints alone."""

import numpy as np

from workbench.body.skeleton import joint_of, middle_of
from workbench.body.stature import SIDES
from workbench.utils.arrays import FloatArray

_MIN_BEND = 0.1
"""Distance of a knee from the line from hip to ankle, over its length, from which on the leg is bent: 23 degrees, and
2.5 standard deviations of the definition of a detector's knee, 33 mm (Needham et al. 2021)."""


def bends(joints: FloatArray) -> FloatArray:
    """Return how far forwards the knee of every bent leg (n,) is off the line from hip to ankle, over its length.

    joints: (F, J, 3), m. Forwards is perpendicular to the hips and to the trunk, by the names left and right. With
    exchanged names it is backwards, and bends are negative.
    """
    across = joint_of(joints, "left_hip") - joint_of(joints, "right_hip")
    up = middle_of(joints, "shoulder") - middle_of(joints, "hip")  # not every detector has a neck
    ahead = np.cross(across, up)
    ahead /= np.maximum(np.linalg.norm(ahead, axis=1, keepdims=True), 1e-12)
    by_side = []
    for side in SIDES:
        hip, knee, ankle = (joint_of(joints, f"{side}_{name}") for name in ("hip", "knee", "ankle"))
        leg = ankle - hip
        length = np.maximum(np.linalg.norm(leg, axis=1, keepdims=True), 1e-12)
        offset = (knee - hip) - ((knee - hip) * leg).sum(axis=1, keepdims=True) * leg / length**2
        bent = np.linalg.norm(offset, axis=1) > _MIN_BEND * length[:, 0]
        by_side.append(((offset * ahead).sum(axis=1) / length[:, 0])[bent])
    each = np.concatenate(by_side)
    return each[np.isfinite(each)]
