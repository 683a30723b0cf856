"""The skeleton: joints, parents, axes, offsets and limits as arrays.

Conventions, used everywhere: right-handed frames, metres, radians. In the neutral pose (all angles zero) the
person stands upright with hanging arms and every joint's frame is parallel to the root's: x forward, y to the
person's left, z up. A limb lies along its frame's z axis (paper A, section 3); arms and legs hang along -z.
The world's z axis points up.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from workbench.body.shape import Shape, Triple
from workbench.utils.arrays import FloatArray, IntArray
from workbench.utils.errors import InputError

_PARENTS = {
    "pelvis": None, "neck": "pelvis", "head_centre": "neck",
    "left_shoulder": "pelvis", "left_elbow": "left_shoulder", "left_wrist": "left_elbow",
    "right_shoulder": "pelvis", "right_elbow": "right_shoulder", "right_wrist": "right_elbow",
    "left_hip": "pelvis", "left_knee": "left_hip", "left_ankle": "left_knee",
    "right_hip": "pelvis", "right_knee": "right_hip", "right_ankle": "right_knee",
}  # fmt: skip
JOINT_NAMES = tuple(_PARENTS)
ERROR_JOINTS = JOINT_NAMES[1:]
"""The 14 joints of the mean joint error: all but the pelvis, the root."""
_FOOT_PARENTS = {
    f"{side}_{joint}": f"{side}_{parent}"
    for side in ("left", "right")
    for joint, parent in (("foot", "ankle"), ("heel", "foot"), ("toes", "foot"))
}
FOOT_POINTS = tuple(name for name, parent in _FOOT_PARENTS.items() if parent.endswith("_foot"))
"""The ends of the feet, left_heel, left_toes, right_heel and right_toes."""
JOINT_NAMES_WITH_FEET = (*JOINT_NAMES, *_FOOT_PARENTS)
"""The joints of a person whose feet move: JOINT_NAMES, and of each foot the joint at the ankle that carries it, heel
and toes."""


@dataclass(frozen=True, eq=False)
class Skeleton:
    """J joints moved by P degrees of freedom; P = 25 for the person of paper A.

    names: J joint names, parents before children. parents: (J,), -1 for the root.
    offsets: (J, 3), a joint's place in its parent's frame, m (the root's is zero).
    dof_names: P names. dof_joints: (P,), the joint of a degree of freedom, non-decreasing.
    dof_axes: (P, 3) unit vectors. The first three translate the root along the world's axes; every other one rotates
    its joint's frame about its axis. A joint's rotations are multiplied in the order of the columns, outermost first.
    limits: (P, 2), lower and upper bound, rad (m for the translations).
    """

    names: tuple[str, ...]
    parents: IntArray
    offsets: FloatArray
    dof_names: tuple[str, ...]
    dof_joints: IntArray
    dof_axes: FloatArray
    limits: FloatArray

    def joint(self, name: str) -> int:
        """Return the index of the joint of this name; raises ValueError if there is none."""
        return self.names.index(name)

    def dof(self, name: str) -> int:
        """Return the index of the degree of freedom of this name; raises ValueError if there is none."""
        return self.dof_names.index(name)

    @property
    def has_feet(self) -> bool:
        """Whether this is a person's skeleton with feet, see `feet_skeleton`."""
        return self.names == JOINT_NAMES_WITH_FEET

    @property
    def bones(self) -> IntArray:
        """(J - 1, 2) pairs of joints (parent, child)."""
        children = np.flatnonzero(self.parents >= 0)
        return np.stack([self.parents[children], children], axis=1)


X, Y, Z = (1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0)
# (name, joint, axis, lower, upper). Signs are anatomical: flexion and abduction are positive on both sides, so that
# mirrored poses have equal numbers. The root turns as Rz Ry Rx (paper A, section 3). A shoulder abducts first so that
# its singular direction is straight ahead, a hip flexes first so that its singular direction is straight to the side.
_FREE = 1e6
_ROOT_DOFS = (
    ("root_x", "pelvis", X, -_FREE, _FREE), ("root_y", "pelvis", Y, -_FREE, _FREE),
    ("root_z", "pelvis", Z, -_FREE, _FREE), ("root_heading", "pelvis", Z, -_FREE, _FREE),
    ("root_pitch", "pelvis", Y, -_FREE, _FREE), ("root_roll", "pelvis", X, -_FREE, _FREE),
    ("neck_turn", "neck", Z, -1.4, 1.4), ("neck_nod", "neck", Y, -1.2, 1.2), ("neck_tilt", "neck", X, -0.8, 0.8),
)  # fmt: skip


def _arm_dofs(side: str, left: float) -> tuple[tuple[str, str, Triple, float, float], ...]:
    return (
        (f"{side}_shoulder_abduction", f"{side}_shoulder", (left, 0.0, 0.0), -0.8, 3.1),
        (f"{side}_shoulder_flexion", f"{side}_shoulder", (0.0, -1.0, 0.0), -1.4, 3.1),
        (f"{side}_shoulder_twist", f"{side}_shoulder", (0.0, 0.0, -left), -1.9, 1.9),
        (f"{side}_elbow_flexion", f"{side}_elbow", (0.0, -1.0, 0.0), -0.1, 2.7),
    )


def _leg_dofs(side: str, left: float) -> tuple[tuple[str, str, Triple, float, float], ...]:
    return (
        (f"{side}_hip_flexion", f"{side}_hip", (0.0, -1.0, 0.0), -0.9, 2.2),
        (f"{side}_hip_abduction", f"{side}_hip", (left, 0.0, 0.0), -0.7, 1.2),
        (f"{side}_hip_twist", f"{side}_hip", (0.0, 0.0, -left), -0.9, 0.9),
        (f"{side}_knee_flexion", f"{side}_knee", (0.0, 1.0, 0.0), -0.1, 2.6),
    )


_PERSON_DOFS = (
    _ROOT_DOFS + _arm_dofs("left", 1.0) + _arm_dofs("right", -1.0) + _leg_dofs("left", 1.0) + _leg_dofs("right", -1.0)
)
POSE_NAMES = tuple(dof[0] for dof in _PERSON_DOFS)
"""The 25 numbers of a pose, in order: root position, root rotation, 19 joint angles."""
N_ROOT = 6
# Dorsiflexion, which lifts the toes, is positive; 0 is a foot at right angles to the calf. Limits: plantarflexion of
# 56° (Boone & Azen 1979); dorsiflexion of 34°, which weight on a bent leg reaches in recorded bends and jumps.
_FOOT_DOFS = tuple(
    (f"{side}_ankle_flexion", f"{side}_foot", (0.0, -1.0, 0.0), -0.98, 0.6) for side in ("left", "right")
)
POSE_NAMES_WITH_FEET = (*POSE_NAMES, *(dof[0] for dof in _FOOT_DOFS))
"""The 27 numbers of a pose with feet: POSE_NAMES, and the flexions of the ankles."""
PARTS = {
    "root": POSE_NAMES[:N_ROOT],
    "body": POSE_NAMES[N_ROOT:],
    "upper_body": tuple(name for name in POSE_NAMES[N_ROOT:] if "hip" not in name and "knee" not in name),
    "lower_body": tuple(name for name in POSE_NAMES if "hip" in name or "knee" in name),
    "left_arm": tuple(name for name in POSE_NAMES if name.startswith(("left_shoulder", "left_elbow"))),
    "right_arm": tuple(name for name in POSE_NAMES if name.startswith(("right_shoulder", "right_elbow"))),
}
"""Names of groups of parameters."""


def parameters(option: str, names: Sequence[str]) -> tuple[str, ...]:
    """Return, in the pose's order, the parameters of `names`, which are parameters or keys of PARTS; raises InputError,
    naming the `option`, if one is unknown."""
    if unknown := [name for name in names if name not in POSE_NAMES and name not in PARTS]:
        expected = f"expected parts of the body ({', '.join(PARTS)}) or some of {', '.join(POSE_NAMES)}"
        raise InputError(f"{option}: {unknown[0]!r} is unknown, {expected}")
    wanted = {parameter for name in names for parameter in PARTS.get(name, (name,))}
    return tuple(name for name in POSE_NAMES if name in wanted)


def person_skeleton(shape: Shape) -> Skeleton:
    """Return the 25-parameter person of paper A (reading in EQUATIONS A, "Body") with the limb lengths of `shape`."""
    return _skeleton(_PARENTS, _PERSON_DOFS, _offsets(shape))


def feet_skeleton(shape: Shape) -> Skeleton:
    """Return `person_skeleton` with moving feet: its joints and numbers come first, followed by the feet's."""
    offsets = _offsets(shape)
    for side in ("left", "right"):
        offsets |= {f"{side}_foot": (0.0, 0.0, 0.0), f"{side}_heel": shape.heel, f"{side}_toes": shape.toes}
    return _skeleton({**_PARENTS, **_FOOT_PARENTS}, (*_PERSON_DOFS, *_FOOT_DOFS), offsets)


def without_feet(skeleton: Skeleton) -> Skeleton:
    """Return the person's part of a skeleton with feet, another skeleton itself."""
    if not skeleton.has_feet:
        return skeleton
    n, p = len(JOINT_NAMES), len(POSE_NAMES)
    return Skeleton(
        JOINT_NAMES, skeleton.parents[:n], skeleton.offsets[:n], POSE_NAMES, skeleton.dof_joints[:p],
        skeleton.dof_axes[:p], skeleton.limits[:p],
    )  # fmt: skip


def _skeleton(
    parents: Mapping[str, str | None], dofs: Sequence[tuple[str, str, Triple, float, float]],
    offsets: Mapping[str, Triple],
) -> Skeleton:  # fmt: skip
    names = tuple(parents)
    return Skeleton(
        names=names, parents=np.array([-1 if parent is None else names.index(parent) for parent in parents.values()]),
        offsets=np.array([offsets[name] for name in names]), dof_names=tuple(dof[0] for dof in dofs),
        dof_joints=np.array([names.index(dof[1]) for dof in dofs]),
        dof_axes=np.array([dof[2] for dof in dofs]), limits=np.array([dof[3:] for dof in dofs]),
    )  # fmt: skip


def _offsets(shape: Shape) -> dict[str, Triple]:
    """Return the offsets of JOINT_NAMES by name, m."""
    offsets: dict[str, Triple] = {"pelvis": (0.0, 0.0, 0.0), "neck": shape.neck, "head_centre": shape.head}
    for side, left in (("left", 1.0), ("right", -1.0)):
        mirror = np.array([1.0, left, 1.0])
        offsets[f"{side}_shoulder"] = tuple(mirror * shape.shoulder)
        offsets[f"{side}_hip"] = tuple(mirror * shape.hip)
        lengths = {"elbow": shape.upper_arm, "wrist": shape.forearm, "knee": shape.thigh, "ankle": shape.calf}
        offsets |= {f"{side}_{joint}": (0.0, 0.0, -length) for joint, length in lengths.items()}
    return offsets


def joint_of(joints: FloatArray, name: str) -> FloatArray:
    """Return the positions (..., D) of a joint, of joints (..., J, D) in the order of JOINT_NAMES."""
    return joints[..., JOINT_NAMES.index(name), :]


def middle_of(joints: FloatArray, name: str) -> FloatArray:
    """Return the middles (..., D) of a joint's left and right side, of joints (..., J, D) in the order of
    JOINT_NAMES."""
    return 0.5 * (joint_of(joints, f"left_{name}") + joint_of(joints, f"right_{name}"))


def without_side(name: str) -> str:
    """Return the name of a joint, an angle or a limb without its side."""
    return name.removeprefix("left_").removeprefix("right_")
