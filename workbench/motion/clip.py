"""A clip: the skeleton and the movement of one motion file, as they are in the file but in the workbench's world."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from workbench.utils.arrays import FloatArray, IntArray
from workbench.utils.input_limits import check_places, check_rate

WORLD_FROM_FILE = [2, 0, 1]
"""Motion files are y-up with the person facing z: (x, y, z) world = (z, x, y) file. The axes are permuted cyclically,
so right-handed stays right-handed; a person who faces z in the file faces x in the world, with z up."""
FILE_FROM_WORLD = [1, 2, 0]  # the inverse


@dataclass(frozen=True, eq=False)
class MotionClip:
    """F frames of a skeleton of K joints, in the workbench's world: right-handed, z up, metres.

    name: the file's, without its extension. first_frame: the number of the first frame in the file. joints: K names,
    parents before children. parents: (K,), -1 for the root. offsets: (K, 3), a joint's place in its parent's frame at
    rest. rotations: (F, K, 3, 3), from a joint's frame to its parent's (the root's: to the world). positions:
    (F, K, 3), every joint in the world by forward kinematics; where the file moves a joint within its parent's frame,
    that movement is in the positions and the offsets keep the place at rest.
    """

    name: str
    rate_hz: float
    first_frame: int
    joints: tuple[str, ...]
    parents: IntArray
    offsets: FloatArray
    rotations: FloatArray
    positions: FloatArray

    def __len__(self) -> int:
        return len(self.positions)

    def joint(self, name: str) -> int:
        """Index of the joint called `name`; raises ValueError when there is none."""
        return self.joints.index(name)

    @cached_property
    def orientations(self) -> FloatArray:
        """Rotations (F, K, 3, 3) from every joint's frame to the world."""
        return world_rotations(self.parents, self.rotations)


def clip_of_file(
    name: str, rate_hz: float, first_frame: int, joints: tuple[str, ...], parents: IntArray, offsets: FloatArray,
    rotations: FloatArray, places: FloatArray,
) -> MotionClip:  # fmt: skip
    """Return the clip of a y-up file's content, turned into the world's axes, with the joints placed.

    offsets (K, 3), m, and rotations (F, K, 3, 3) as in `MotionClip`, but in the file's axes. places: (F, K, 3), m,
    where every joint is in its parent's frame at every frame; the root's is its position.
    """
    rotations = rotations[..., WORLD_FROM_FILE, :][..., WORLD_FROM_FILE]
    places = places[..., WORLD_FROM_FILE]
    positions = joint_positions(parents, world_rotations(parents, rotations), places)
    offsets = offsets[:, WORLD_FROM_FILE]
    check_rate(f"clip {name}", rate_hz)
    check_places(f"clip {name}", positions)
    return MotionClip(name, rate_hz, first_frame, joints, parents, offsets, rotations, positions)


def world_rotations(parents: IntArray, rotations: FloatArray) -> FloatArray:
    """Return world rotations (F, K, 3, 3) of joints from the rotations (F, K, 3, 3) to their parents."""
    world = rotations.copy()
    for k, parent in enumerate(parents):
        if parent >= 0:
            world[:, k] = world[:, parent] @ rotations[:, k]
    return world


def joint_positions(parents: IntArray, world: FloatArray, places: FloatArray) -> FloatArray:
    """Return joint positions (F, K, 3) of world rotations (F, K, 3, 3) and places (F, K, 3) in the parents' frames."""
    positions = places.copy()
    for k, parent in enumerate(parents):
        if parent >= 0:
            positions[:, k] = positions[:, parent] + np.einsum("fab,fb->fa", world[:, parent], places[:, k])
    return positions
