"""The body's geometry: truncated cones and spheres hung on the skeleton's joints (paper A, section 3)."""

from dataclasses import dataclass

import numpy as np

from workbench.arrays import BoolArray, FloatArray, IntArray
from workbench.body.shape import Shape
from workbench.body.skeleton import JOINT_NAMES, Skeleton, person_skeleton


@dataclass(frozen=True, eq=False)
class Limbs:
    """L limbs as a structure of arrays; lengths in metres, coordinates in the frame of the limb's joint.

    names: L names. joints: (L,), the joint whose frame carries the limb. starts, ends: (L, 3), the axis' end points
    (equal for a sphere). radii: (L, 2, 2), [start or end, (along the frame's x, along its y)] semi-axes of the
    section. spheres: (L,) bool. A limb that is not a sphere is a truncated cone with elliptical section.
    """

    names: tuple[str, ...]
    joints: IntArray
    starts: FloatArray
    ends: FloatArray
    radii: FloatArray
    spheres: BoolArray

    def __len__(self) -> int:
        return len(self.names)


@dataclass(frozen=True, eq=False)
class Body:
    """One person: the skeleton with this person's offsets, and the limbs on it."""

    skeleton: Skeleton
    shape: Shape
    limbs: Limbs


def person(shape: Shape) -> Body:
    """The 12 limbs of paper A on the 25-parameter skeleton: torso, head, and two of each arm and leg part and hand."""
    return Body(skeleton=person_skeleton(shape), shape=shape, limbs=_person_limbs(shape))


def _person_limbs(shape: Shape) -> Limbs:
    origin = (0.0, 0.0, 0.0)
    low, high = np.array(shape.torso_radii_low), np.array(shape.torso_radii_high)
    top = (shape.neck[0], shape.neck[1], shape.neck[2] - 0.02)
    rows = [
        ("torso", "pelvis", origin, top, (low, high), False),
        ("head", "neck", shape.head, shape.head, _round(shape.head_radius, shape.head_radius), True),
    ]
    for side in ("left", "right"):
        wrist = (0.0, 0.0, -shape.forearm)
        hand = (0.0, 0.0, -shape.forearm - 1.2 * shape.hand_radius)
        rows += [
            (f"{side}_upper_arm", f"{side}_shoulder", origin, (0.0, 0.0, -shape.upper_arm),
             _round(*shape.upper_arm_radii), False),
            (f"{side}_forearm", f"{side}_elbow", origin, wrist, _round(*shape.forearm_radii), False),
            (f"{side}_hand", f"{side}_elbow", hand, hand, _round(shape.hand_radius, shape.hand_radius), True),
            (f"{side}_thigh", f"{side}_hip", origin, (0.0, 0.0, -shape.thigh), _round(*shape.thigh_radii), False),
            (f"{side}_calf", f"{side}_knee", origin, (0.0, 0.0, -shape.calf), _round(*shape.calf_radii), False),
        ]  # fmt: skip
    names, joints, starts, ends, radii, spheres = zip(*rows, strict=True)
    return Limbs(
        names=names,
        joints=np.array([JOINT_NAMES.index(joint) for joint in joints]),
        starts=np.array(starts),
        ends=np.array(ends),
        radii=np.array(radii),
        spheres=np.array(spheres),
    )


def _round(start: float, end: float) -> tuple[FloatArray, FloatArray]:
    return np.full(2, start), np.full(2, end)
