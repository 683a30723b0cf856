"""BVH text of a motion: the skeleton as a hierarchy of joints, then one line of channel values a frame.

BVH has no specification; this is what Biovision's files look like and what `workbench.mocap.bvh` and Blender read.
"""

import numpy as np

from workbench.arrays import FloatArray
from workbench.body.skeleton import Skeleton

FILE_FROM_WORLD = [1, 2, 0]
"""Motion files are y-up with the person facing z: (x, y, z) file = (y, z, x) world, the inverse of what readers do."""
PER_METRE = {"m": 1.0, "cm": 100.0, "mm": 1000.0}
_DIGITS = 6  # a millionth of a degree moves a hand by 10 nm
_N_POSITIONS = 3


def bvh_text(skeleton: Skeleton, poses: FloatArray, rate_hz: float, unit: str = "cm") -> str:
    """The BVH file of poses (F, P), m and rad, at `rate_hz` frames per second; lengths in `unit`, "cm" or "m".

    A joint's channels are its own angles in degrees, in the skeleton's order, with the sign of their axis: BVH too
    multiplies a joint's turns outermost first. Nothing is converted, so angles stay continuous and no pose is
    singular. Where a joint has fewer than three turns the others are zero, since readers expect three. A joint without
    children becomes the End Site of its parent, which has no name.

    Raises ValueError for another unit and for a skeleton that turns a joint about anything but three different axes
    of its frame.
    """
    if unit not in ("cm", "m"):
        raise ValueError(f"the unit of a BVH file must be cm or m, found {unit!r}")
    hierarchy, columns = _branch(skeleton, 0, PER_METRE[unit], depth=0)
    signs = skeleton.dof_axes.sum(axis=1)  # of axes ±x, ±y, ±z; the positions' are +1
    scales = np.where(np.arange(len(signs)) < _N_POSITIONS, PER_METRE[unit], np.rad2deg(1.0) * signs)
    padded = np.hstack([poses * scales, np.zeros((len(poses), 1))])  # column -1: a turn the joint does not have
    values = np.round(padded[:, columns], _DIGITS) + 0.0  # no "-0.000000"
    rows = [" ".join([f"{value:.{_DIGITS}f}" for value in row]) for row in values.tolist()]
    head = ["MOTION", f"Frames: {len(poses)}", f"Frame Time: {1.0 / rate_hz:.9f}"]
    return "\n".join(["HIERARCHY", *hierarchy, *head, *rows, ""])


def _branch(skeleton: Skeleton, joint: int, scale: float, depth: int) -> tuple[list[str], list[int]]:
    """The lines of a joint and what hangs on it, and the pose's column for each of their channels (-1: none)."""
    tab = "\t" * depth
    children = np.flatnonzero(skeleton.parents == joint).tolist()
    kind = f"{'JOINT' if depth else 'ROOT'} {skeleton.names[joint]}" if children else "End Site"
    offset = np.round(skeleton.offsets[joint, FILE_FROM_WORLD] * scale, _DIGITS) + 0.0
    lines = [f"{tab}{kind}", f"{tab}{{", f"{tab}\tOFFSET {' '.join([f'{value:.{_DIGITS}f}' for value in offset])}"]
    columns: list[int] = []
    if children:
        names, columns = _channels(skeleton, joint)
        lines.append(f"{tab}\tCHANNELS {len(names)} {' '.join(names)}")
    for child in children:
        below, more = _branch(skeleton, child, scale, depth + 1)
        lines += below
        columns += more
    return [*lines, f"{tab}}}"], columns


def _channels(skeleton: Skeleton, joint: int) -> tuple[list[str], list[int]]:
    """Names of a joint's channels, and the pose's column for each (-1: none)."""
    positions = dict.fromkeys(("Xposition", "Yposition", "Zposition"), -1) if joint == 0 else {}
    turns: dict[str, int] = {}
    for column in np.flatnonzero(skeleton.dof_joints == joint).tolist():
        axis = np.abs(skeleton.dof_axes[column])
        letter = "XYZ"[FILE_FROM_WORLD.index(int(np.argmax(axis)))]
        if column < _N_POSITIONS:
            positions[f"{letter}position"] = column
        elif axis.max() == axis.sum() == 1.0 and f"{letter}rotation" not in turns:
            turns[f"{letter}rotation"] = column
        else:
            raise ValueError(f"{skeleton.names[joint]}: BVH turns a joint about its x, y and z axes, once each")
    missing = {f"{letter}rotation": -1 for letter in "XYZ" if f"{letter}rotation" not in turns}
    channels = positions | turns | missing
    return list(channels), list(channels.values())
