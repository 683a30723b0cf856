"""A motion clip: the skeleton and motion of one motion file, in the workbench's world frame."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from workbench.utils.arrays import FloatArray, IntArray

FILE_FROM_WORLD = [1, 2, 0]
"""Axes of a file that is y-up with the person facing z, as usual: (x, y, z) file = (y, z, x) world. They are permuted
cyclically, which preserves handedness."""


@dataclass(frozen=True, eq=False)
class MotionClip:
    """F frames of a skeleton of K joints, in the workbench's world: right-handed, z up, metres.

    name : the file's, without its extension. joints : K names, parents before children. parents : (K,), -1 for the
    root. offsets : (K, 3), a joint's rest position in its parent's frame. rotations : (F, K, 3, 3), from a joint's
    frame to its parent's (of the root: to the world). positions : (F, K, 3), every joint in the world by forward
    kinematics. If the file translates a joint within its parent's frame, the positions include the translation and the
    offsets are those at rest.
    """

    name: str
    rate_hz: float
    joints: tuple[str, ...]
    parents: IntArray
    offsets: FloatArray
    rotations: FloatArray
    positions: FloatArray

    def __len__(self) -> int:
        return len(self.positions)

    def joint(self, name: str) -> int:
        """Return the index of the joint `name`; raises ValueError if there is none."""
        return self.joints.index(name)

    @cached_property
    def orientations(self) -> FloatArray:
        """Rotations (F, K, 3, 3) from every joint's frame to the world."""
        return world_rotations(self.parents, self.rotations)


def world_rotations(parents: IntArray, rotations: FloatArray) -> FloatArray:
    """Return world rotations (F, K, 3, 3) of joints from the rotations (F, K, 3, 3) to their parents."""
    world = rotations.copy()
    for k, parent in enumerate(parents):
        if parent >= 0:
            world[:, k] = world[:, parent] @ rotations[:, k]
    return world


def joint_positions(parents: IntArray, world: FloatArray, translations: FloatArray) -> FloatArray:
    """Return joint positions (F, K, 3) from world rotations (F, K, 3, 3) and translations (F, K, 3) to the parents."""
    positions = translations.copy()
    for k, parent in enumerate(parents):
        if parent >= 0:
            positions[:, k] = positions[:, parent] + np.einsum("fab,fb->fa", world[:, parent], translations[:, k])
    return positions
