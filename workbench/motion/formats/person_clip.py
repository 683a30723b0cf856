"""The clip of a motion file in metres with z up, by the person's size and posture."""

from collections.abc import Mapping
from pathlib import Path

import numpy as np

from workbench.body.stature import stature
from workbench.motion.clip import MotionClip, joint_positions, world_rotations
from workbench.motion.formats.joint_names import skeleton_joints
from workbench.motion.formats.units_axes import metres_per_unit, upward, vertical_axis, world_axes
from workbench.utils.arrays import FloatArray, IntArray
from workbench.utils.input_limits import check_places, check_rate

_POSTURES = 200  # frames whose postures determine the unit and the vertical axis


def person_clip(
    path: Path, rate_hz: float, first_frame: int, joints: tuple[str, ...], parents: IntArray, offsets: FloatArray,
    rotations: FloatArray, translations: FloatArray, header: str | float, unit: str | None, up: str | None,
    landmarks: Mapping[str, str] | None = None,
) -> MotionClip:  # fmt: skip
    """Return the clip of a file's content.

    offsets (K, 3) and rotations (F, K, 3, 3) are as in `MotionClip`, but in the file's unit and axes. translations :
    (F, K, 3), position of every joint in its parent's frame, and of the root in the world. header : the unit by the
    file or the format's convention, a name or metres. unit, up : by the user, see `metres_per_unit` and
    `vertical_axis`; usually y is up. landmarks : the file's joints by the person's joints, where `joint_names` does not
    have them. Raises InputError for an implausible size or posture.
    """
    person = skeleton_joints(joints, parents.tolist(), landmarks, path)
    some = np.unique(np.linspace(0, len(rotations) - 1, _POSTURES).astype(int))
    places = joint_positions(parents, world_rotations(parents, rotations[some]), translations[some])
    known = {joint: places[:, joints.index(name)] for joint, name in person.items()}
    metres = metres_per_unit(path, stature(known), header, unit)
    axes = world_axes(vertical_axis(path, upward(known), "y", up))
    rotations, translations = axes.rotations(rotations), axes.vectors(translations * metres)
    positions = joint_positions(parents, world_rotations(parents, rotations), translations)
    check_rate(f"clip {path.stem}", rate_hz)
    check_places(f"clip {path.stem}", positions)
    offsets = axes.vectors(offsets * metres)
    return MotionClip(path.stem, rate_hz, first_frame, joints, parents, offsets, rotations, positions)
