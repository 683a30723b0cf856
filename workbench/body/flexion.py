"""The flexion of hips and knees, by which paper D compares a fit with the truth (figs. 5 to 9)."""

from collections.abc import Mapping

import numpy as np

from workbench.body.skeleton import Skeleton
from workbench.utils.arrays import FloatArray

FLEXIONS: Mapping[str, Mapping[str, float]] = {
    "left_hip": {"left_hip_flexion": 1.0, "UpperLeg_L_y": -1.0, "lfemur_y": -1.0},
    "right_hip": {"right_hip_flexion": 1.0, "UpperLeg_R_y": -1.0, "rfemur_y": -1.0},
    "left_knee": {"left_knee_flexion": 1.0, "LowerLeg_L_y": 1.0, "ltibia_y": 1.0},
    "right_knee": {"right_knee_flexion": 1.0, "LowerLeg_R_y": 1.0, "rtibia_y": 1.0},
}
"""The degree of freedom, and its sign, in the person's skeleton and in the full ones of Bandai's and CMU's files."""


def flexions(skeleton: Skeleton, pose: FloatArray) -> dict[str, float]:
    """Degrees, from −180 to 180, of those of FLEXIONS that a skeleton has, in a pose (P,)."""
    return {
        name: wrapped_deg(sign * float(np.degrees(pose[skeleton.dof(dof)])))
        for name, signs in FLEXIONS.items()
        for dof, sign in signs.items()
        if dof in skeleton.dof_names
    }


def wrapped_deg(angle: float) -> float:
    """Wrap an angle, degrees, into −180 to 180."""
    return (angle + 180.0) % 360.0 - 180.0
