"""Joint angles as they are reported, by the conventions of the ISB and the signs of OpenSim."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from workbench.body.stature import SIDES
from workbench.utils.arrays import FloatArray


@dataclass(frozen=True)
class Convention:
    """How an angle is defined. title: for tables. positive: the direction of positive values. source: publication."""

    title: str
    positive: str
    source: str


_HIP = "joint coordinate system of the hip (ISB: Wu et al. 2002)"
_TORSO = "torso against the vertical and the walk, as rotation, obliquity and tilt in this order (Baker 2001)"
CONVENTIONS = {
    "torso_tilt": Convention("torso tilt", "backwards", _TORSO),
    "torso_list": Convention("torso list", "to the right", _TORSO),
    "torso_rotation": Convention("torso rotation", "to the left", f"{_TORSO}, from the direction of the walk"),
    "hip_flexion": Convention("hip flexion", "flexion", _HIP),
    "hip_adduction": Convention("hip adduction", "adduction", _HIP),
    "hip_rotation": Convention("hip rotation", "internal", _HIP),
    "knee_flexion": Convention("knee flexion", "flexion", "about the knee's lateral axis (Grood & Suntay 1983)"),
    "ankle_flexion": Convention(
        "ankle flexion", "dorsiflexion", "joint coordinate system of the ankle (ISB: Wu et al. 2002), 0 at 90°"
    ),
    "shoulder_flexion": Convention("shoulder flexion", "forwards", "of the upper arm in the torso's sagittal plane"),
    "shoulder_elevation": Convention(
        "shoulder elevation", "away from the torso", "angle of humerus and thorax (ISB: Wu et al. 2005)"
    ),
    "elbow_flexion": Convention("elbow flexion", "flexion", "about the elbow's lateral axis (ISB: Wu et al. 2005)"),
}
"""Angles in the order of tables. The torso is pelvis, trunk and shoulders in one, as in the body."""
_ORDER = {name: k for k, name in enumerate(CONVENTIONS)}
GAIT_ANGLES = tuple(name for name in CONVENTIONS if not name.startswith(("shoulder", "elbow")))
"""Angles shown over the gait cycle."""


@dataclass(frozen=True, eq=False)
class JointAngles:
    """A angles in motions. names: A keys of CONVENTIONS. sides: A, left, right or both. values: (..., A), rad."""

    names: tuple[str, ...]
    sides: tuple[str, ...]
    values: FloatArray

    def chosen(self, columns: Sequence[int]) -> "JointAngles":
        """Return some of the angles, in the order of CONVENTIONS."""
        ordered = sorted(columns, key=lambda k: (_ORDER[self.names[k]], self.sides[k]))
        names, sides = (tuple(each[k] for k in ordered) for each in (self.names, self.sides))
        return JointAngles(names, sides, self.values[..., ordered])


def joint_angles(dof_names: Sequence[str], poses: FloatArray) -> JointAngles:
    """Return the reported angles of poses (..., P) with parameters of these names, those of POSE_NAMES and possibly
    flexions of the ankles.

    Hips, knees, ankles and elbows are the body's own parameters: a hip flexes, abducts and rotates in the order of its
    joint coordinate system. torso_rotation is the heading in the world.
    """

    def dof(name: str) -> FloatArray:
        return poses[..., dof_names.index(name)]

    tilt, obliquity, rotation = _torso(dof("root_heading"), dof("root_pitch"), dof("root_roll"))
    columns = [("torso_tilt", "both", tilt), ("torso_list", "both", obliquity), ("torso_rotation", "both", rotation)]
    for side in SIDES:
        abduction, flexion = dof(f"{side}_shoulder_abduction"), dof(f"{side}_shoulder_flexion")
        columns += [
            ("hip_flexion", side, dof(f"{side}_hip_flexion")),
            ("hip_adduction", side, -dof(f"{side}_hip_abduction")),
            ("hip_rotation", side, dof(f"{side}_hip_twist")),
            ("knee_flexion", side, dof(f"{side}_knee_flexion")),
            ("shoulder_flexion", side, np.arctan2(np.sin(flexion), np.cos(flexion) * np.cos(abduction))),
            ("shoulder_elevation", side, np.arccos(np.clip(np.cos(flexion) * np.cos(abduction), -1.0, 1.0))),
            ("elbow_flexion", side, dof(f"{side}_elbow_flexion")),
        ]
        if f"{side}_ankle_flexion" in dof_names:
            columns.append(("ankle_flexion", side, dof(f"{side}_ankle_flexion")))
    names, sides, values = zip(*columns, strict=True)
    return JointAngles(names, sides, np.stack(values, axis=-1))


def _torso(heading: FloatArray, pitch: FloatArray, roll: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return tilt backwards, list to the right and rotation to the left of a root rotated by Rz(heading) Ry(pitch)
    Rx(roll): the angles of the same rotation Rz(rotation) Rx(list) Ry(−tilt)."""
    tilt = -np.arctan2(np.sin(pitch), np.cos(pitch) * np.cos(roll))
    obliquity = np.arcsin(np.clip(np.cos(pitch) * np.sin(roll), -1.0, 1.0))
    rotation = heading - np.arctan2(np.sin(pitch) * np.sin(roll), np.cos(roll))
    return tilt, obliquity, rotation
