"""The body's geometry: truncated cones and spheres on the skeleton's joints (paper A, section 3)."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from types import MappingProxyType
from typing import Any

import numpy as np

from workbench.body.shape import ANKLE_HEIGHT, TOES_HEIGHT, Shape
from workbench.body.skeleton import (
    JOINT_NAMES,
    JOINT_NAMES_WITH_FEET,
    Skeleton,
    feet_skeleton,
    person_skeleton,
    without_feet,
)
from workbench.utils.arrays import BoolArray, FloatArray, IntArray
from workbench.utils.errors import InputError

FOOT_BREADTH, _HEEL_BREADTH = 0.055, 0.0396
"""Breadth of a foot and of its heel as fractions of the height: the first by Drillis & Contini 1966, in Winter,
*Biomechanics and Motor Control of Human Movement*, 4th ed. 2009, fig. 4.1, the second our value."""
_NECK_BELOW, _NECK_RADII = 0.015, ((0.036, 0.036), (0.034, 0.032))
"""Of a neck, as fractions of the height, our values: depth of its lower end below its joint, and its radii there and at
the head."""
_CHIN = 0.65
"""Depth of the neck's upper end below the head's centre, in the head's radii."""

CONTINUED = (
    ("torso", "head"), ("torso", "neck"), ("neck", "head"),
    *((f"{side}_{limb}", f"{side}_{next_limb}") for side in ("left", "right") for limb, next_limb in (
        ("upper_arm", "forearm"), ("forearm", "hand"), ("thigh", "calf"), ("calf", "foot"))),
    ("torso", "left_thigh"), ("torso", "right_thigh"),
)  # fmt: skip
"""Limbs of a person that continue each other from one joint on. An arm next to the torso does not continue it."""


@dataclass(frozen=True, eq=False)
class Limbs:
    """L limbs as a structure of arrays; lengths in metres, coordinates in the frame of the limb's joint. names: L
    names. joints: (L,), whose frames carry the limbs. starts, ends: (L, 3), of the axes (equal for a sphere). radii:
    (L, 2, 2), [start or end, (along the limb's x, along its y)] semi-axes of the section. spheres: (L,) bool. A limb
    that is not a sphere is a truncated cone with elliptical section."""

    names: tuple[str, ...]
    joints: IntArray
    starts: FloatArray
    ends: FloatArray
    radii: FloatArray
    spheres: BoolArray

    def __len__(self) -> int:
        return len(self.names)

    @cached_property
    def lengths(self) -> FloatArray:
        """(L,), m; 0 for a sphere."""
        return np.linalg.norm(self.ends - self.starts, axis=1)

    @cached_property
    def mean_radii(self) -> FloatArray:
        """(L, 2), m, at start and end: the means of the sections' semi-axes."""
        return np.asarray(self.radii.mean(axis=2))

    @cached_property
    def connected(self) -> BoolArray:
        """(L, L), whether two limbs continue each other, by their names in CONTINUED."""
        return np.array([[(a, b) in CONTINUED or (b, a) in CONTINUED for b in self.names] for a in self.names])

    @cached_property
    def axes(self) -> FloatArray:
        """The limbs' axes (L, 3, 3), as columns: z along the limb, x as close as possible to forward, or to up if the
        limb points forward. A sphere's are its joint's."""
        along = (self.ends - self.starts) / np.maximum(self.lengths, 1e-12)[:, None]
        z = np.where(self.lengths[:, None] > 0.0, along, [0.0, 0.0, 1.0])
        x = np.where(np.abs(z[:, :1]) > np.sqrt(0.5), [0.0, 0.0, 1.0], [1.0, 0.0, 0.0])
        x = x - (x * z).sum(axis=1, keepdims=True) * z
        x /= np.linalg.norm(x, axis=1, keepdims=True)
        return np.stack([x, np.cross(z, x), z], axis=2)

    def extended(self, rows: Sequence[tuple[str, str, FloatArray, FloatArray, Any]]) -> "Limbs":
        """Append truncated cones of a person, who may have feet: name, name of the joint, start and end (3,) of the
        axis, and radii (2, 2), m. Raises ValueError for an unknown joint."""
        names, joints, starts, ends, radii = zip(*rows, strict=True)
        return Limbs(
            names=(*self.names, *names),
            joints=np.append(self.joints, [JOINT_NAMES_WITH_FEET.index(joint) for joint in joints]),
            starts=np.concatenate([self.starts, starts]), ends=np.concatenate([self.ends, ends]),
            radii=np.concatenate([self.radii, radii]),
            spheres=np.append(self.spheres, np.zeros(len(rows), dtype=np.bool_)),
        )  # fmt: skip

    def cylinders(self) -> "Limbs":
        """Return all limbs as cylinders, with their sections' mean semi-axes (paper A, section 3.1)."""
        mean = self.radii.mean(axis=1, keepdims=True)
        return replace(self, radii=np.repeat(mean, 2, axis=1))


@dataclass(frozen=True, eq=False)
class Body:
    """One person: the skeleton with the person's offsets, the measurements, and the limbs on the skeleton.
    limb_length_std: (J, 3, G), changes of the offsets, m, for one standard deviation of each of G independent causes;
    None if unknown."""

    skeleton: Skeleton
    shape: Shape
    limbs: Limbs
    limb_length_std: FloatArray | None = None

    @cached_property
    def without_feet(self) -> "Body":
        """The person's part of a body with feet, with the limbs of `person`; another body itself."""
        if not self.skeleton.has_feet:
            return self
        return Body(without_feet(self.skeleton), self.shape, _person_limbs(self.shape))

    def scaled(self, factor: float) -> "Body":
        """Return the body with every length multiplied by `factor`, which preserves the proportions."""
        limbs = self.limbs
        starts, ends, radii = (factor * lengths for lengths in (limbs.starts, limbs.ends, limbs.radii))
        skeleton = replace(self.skeleton, offsets=factor * self.skeleton.offsets)
        limbs = replace(limbs, starts=starts, ends=ends, radii=radii)
        std = None if self.limb_length_std is None else factor * self.limb_length_std
        return Body(skeleton, self.shape.scaled(factor), limbs, std)


def person(shape: Shape) -> Body:
    """Return the 12 limbs of paper A on the 25-parameter skeleton: torso, head, and each side's upper arm, forearm,
    hand, thigh and calf."""
    return Body(skeleton=person_skeleton(shape), shape=shape, limbs=_person_limbs(shape))


def person_with_feet(shape: Shape) -> Body:
    """Return the limbs of `person` with a neck and two feet, on the skeleton whose ankles move."""
    limbs = _person_limbs(shape).extended(_neck_and_feet(shape, "foot", np.zeros(3)))
    return Body(skeleton=feet_skeleton(shape), shape=shape, limbs=limbs)


def person_on(skeleton: str, shape: Shape) -> Body:
    """Return the body of a person on a skeleton by its name: "person" for paper A's, "feet" for that with feet. Raises
    InputError for another name."""
    bodies: Mapping[str, Callable[[Shape], Body]] = {"person": person, "feet": person_with_feet}
    if skeleton not in bodies:
        raise InputError(f"body: skeleton must be one of {', '.join(bodies)}, found {skeleton!r}")
    return bodies[skeleton](shape)


Radii = Mapping[str, tuple[float, float]]
NO_RADII: Radii = MappingProxyType({})
Ends = Mapping[str, tuple[float, float, float]]
NO_ENDS: Ends = MappingProxyType({})


def skeleton_limbs(skeleton: Skeleton, thickness: float = 0.2, radii: Radii = NO_RADII, ends: Ends = NO_ENDS) -> Limbs:
    """Return a cylinder with elliptical section along every bone of a skeleton, named after the bone's distal joint.

    Parameters
    ----------
    skeleton : any; bones without a length, between joints at the same place, have no limb.
    thickness : half size across a bone as a fraction of its length.
    radii : half sizes (m) across the bone that ends at the named joint, fore–aft (vertical if the bone points forward)
        and sideways.
    ends : length and the two half sizes, m, of an extension beyond a joint in the direction of its bone, such as a head
        or a hand; its limb is "<joint>_end".

    Raises
    ------
    InputError : a joint does not exist, or the skeleton has no bones.
    """
    if unknown := sorted(({*radii} | {*ends}) - set(skeleton.names)):
        raise InputError(f"limbs: the skeleton has no joint {unknown[0]!r}, it has {', '.join(skeleton.names)}")
    rows = []
    for joint, parent in enumerate(skeleton.parents):
        name, bone = skeleton.names[joint], skeleton.offsets[joint]
        length = float(np.linalg.norm(bone))
        if parent < 0 or length < 1e-6:
            continue
        rows.append((name, int(parent), bone, radii.get(name, (thickness * length,) * 2)))
        if name in ends:
            reach, x, y = ends[name]
            rows.append((f"{name}_end", joint, reach / length * bone, (x, y)))
    if not rows:
        raise InputError("limbs: expected a skeleton with bones")
    names, joints, bones, sizes = zip(*rows, strict=True)
    return Limbs(
        names=names, joints=np.array(joints), starts=np.zeros((len(rows), 3)), ends=np.array(bones),
        radii=np.repeat(np.array(sizes)[:, None], 2, axis=1), spheres=np.zeros(len(rows), dtype=bool),
    )  # fmt: skip


def _person_limbs(shape: Shape) -> Limbs:
    origin = (0.0, 0.0, 0.0)
    low, high = np.array(shape.torso_radii_low), np.array(shape.torso_radii_high)
    top = (shape.neck[0], shape.neck[1], shape.neck[2] - 0.02)
    rows = [
        ("torso", "pelvis", origin, top, (low, high), False),
        ("head", "neck", shape.head, shape.head, _round(shape.head_radius, shape.head_radius), True),
    ]
    for side in ("left", "right"):
        wrist, hand = (0.0, 0.0, -shape.forearm), (0.0, 0.0, -shape.forearm - 1.2 * shape.hand_radius)
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
        names=names, joints=np.array([JOINT_NAMES.index(joint) for joint in joints]), starts=np.array(starts),
        ends=np.array(ends), radii=np.array(radii), spheres=np.array(spheres),
    )  # fmt: skip


def _round(start: float, end: float) -> tuple[FloatArray, FloatArray]:
    return np.full(2, start), np.full(2, end)


def with_neck_and_feet(body: Body) -> Body:
    """Return a person's body with a neck and two feet appended to its limbs: the neck on its joint, the feet on the
    knees, rigid, at right angles to the calves. Raises InputError for another skeleton than a person's, and if the body
    has them."""
    if body.skeleton.names != JOINT_NAMES or "neck" in body.limbs.names:
        raise InputError("body: neck and feet are added to a person's plain body alone")
    rows = _neck_and_feet(body.shape, "knee", np.array([0.0, 0.0, -body.shape.calf]))
    return replace(body, limbs=body.limbs.extended(rows))


def _neck_and_feet(
    shape: Shape, joint: str, ankle: FloatArray
) -> list[tuple[str, str, FloatArray, FloatArray, FloatArray]]:
    """Return the rows of `Limbs.extended` for the neck and the feet, on a joint of either side, in whose frame the
    ankle is at (3,), m."""
    tall, up = shape.foot_size, np.array([0.0, 0.0, 1.0])
    heel, toes = ankle + np.array([1.0, 1.0, 0.5]) * shape.heel, ankle + shape.toes  # the axis is in the heel's middle
    foot = 0.5 * tall * np.array([[ANKLE_HEIGHT, _HEEL_BREADTH], [TOES_HEIGHT, FOOT_BREADTH]])
    nape, chin = -tall * _NECK_BELOW * up, np.array(shape.head) - _CHIN * shape.head_radius * up
    return [
        ("neck", "neck", nape, chin, tall * np.array(_NECK_RADII)),
        ("left_foot", f"left_{joint}", heel, toes, foot),
        ("right_foot", f"right_{joint}", heel, toes, foot),
    ]
