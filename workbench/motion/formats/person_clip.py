"""The clip of a motion file in metres with z up, by the person's size and posture."""

import logging
from collections.abc import Mapping
from pathlib import Path

import numpy as np

from workbench.body.stature import stature
from workbench.motion.clip import MotionClip, joint_positions, world_rotations
from workbench.motion.formats.joint_names import skeleton_joints
from workbench.motion.formats.units_axes import metres_per_unit, upward, vertical_axis, world_axes
from workbench.utils.arrays import FloatArray, IntArray
from workbench.utils.input_limits import check_places, check_rate

log = logging.getLogger(__name__)

_FASTEST_M_S = 40.0
"""Of a person's joints: the hand of a pitcher throws a ball at 37 m/s (Fleisig et al. 1999, J. Biomech. 32)."""
_JUMP = 2.0
"""Ratio of the speed from or to the rest pose to the fastest one of the motion, from which the pose is no motion."""
_ROUNDING = 1e-6
_POSTURES = 200  # frames whose postures determine the unit and the vertical axis


def person_clip(
    path: Path, rate_hz: float, joints: tuple[str, ...], parents: IntArray, offsets: FloatArray, rotations: FloatArray,
    translations: FloatArray, header: str | float, unit: str | None, up: str | None,
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
    first, end = _moving_rows(path, rate_hz, rotations, positions)
    return MotionClip(path.stem, rate_hz, joints, parents, offsets, rotations[first:end], positions[first:end])


def _moving_rows(path: Path, rate_hz: float, rotations: FloatArray, positions: FloatArray) -> tuple[int, int]:
    """Return the first row of the motion and the end of its rows; rows left out at either end are logged."""
    speeds = np.linalg.norm(np.diff(positions, axis=0), axis=2).max(axis=1, initial=0.0) * rate_hz
    at_rest = np.abs(rotations - np.eye(3)).reshape(len(rotations), -1).max(axis=1) < _ROUNDING
    n_first, n_last = (int(np.argmin(rows)) for rows in (at_rest, at_rest[::-1]))  # 0 if all are at rest
    first = _n_left_out(speeds, n_first, n_last)
    last = _n_left_out(speeds[::-1], n_last, n_first)
    for which, n, jump in (("first", first, first - 1), ("last", last, -last)):
        if n:
            what = f"the {which} {n} rows are" if n > 1 else f"the {which} row is"
            fastest = speeds[first : len(speeds) - last].max()
            log.warning(
                "%s: %s no motion: joints jump there at %.0f m/s, elsewhere they move at %.1f m/s at most; left out",
                path, what, speeds[jump], fastest,
            )  # fmt: skip
    return first, len(rotations) - last


def _n_left_out(speeds: FloatArray, n_rest: int, n_rest_at_end: int) -> int:
    """Return the number of first rows that are no motion, from the speeds (F - 1,), m/s, after each row.

    These are n_rest rows of the rest pose, from which the fastest joint moves more than _JUMP times as fast as ever
    after, or a first row from which alone it moves faster than _FASTEST_M_S. The n_rest_at_end rows do not count.
    """
    n = max(n_rest, 1)
    later = speeds[n : len(speeds) - n_rest_at_end]
    if not len(later):
        return 0
    jump, fastest = speeds[n - 1], later.max()
    return n if (n_rest and jump > _JUMP * fastest) or jump > _FASTEST_M_S >= fastest else 0
