"""3-D markers from TRC files or, with ezc3d (the extra `c3d`), C3D files, and the joints that they mark."""

import logging
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from types import MappingProxyType

import numpy as np

from workbench.body.skeleton import JOINT_NAMES
from workbench.body.stature import stature
from workbench.motion.formats.c3d import read_c3d
from workbench.motion.formats.hip_centres import hip_centres, pelvis_markers
from workbench.motion.formats.joint_names import marker_joints
from workbench.motion.formats.laboratory_markers import is_laboratory_table, laboratory_markers
from workbench.motion.formats.text import read_lines
from workbench.motion.formats.trc import RawMarkers, joints_of_csv, read_trc
from workbench.motion.formats.units_axes import metres_per_unit, upward, vertical_axis, world_axes
from workbench.utils.arrays import BoolArray, FloatArray
from workbench.utils.errors import InputError
from workbench.utils.input_limits import check_places
from workbench.utils.input_path import expanded
from workbench.utils.text import plain_name

log = logging.getLogger(__name__)

MarkersOf = Mapping[str, Sequence[str]]
NO_MARKERS: MarkersOf = MappingProxyType({})
_HIPS = ("left_hip", "right_hip")
_OUTPUT = re.compile(r"(angle|force|moment|power|torque|reaction|cop|grf)s?\d*$")
"""End of the name of a model's output, such as Plug-in Gait's LKneeAngles, which is no position."""

_FROZEN, _MIN_STEPS = 0.5, 10
"""Largest share of the frames, of at least so many, in which one marker has the place of the frame before while all
others move. Measured markers do not, as their noise exceeds the last digit; parts of a foot stand still together."""


@dataclass(frozen=True, eq=False)
class Markers:
    """M markers in F frames at rate_hz. source : the file. positions : (F, M, 3), m, in the world, NaN where
    missing."""

    source: str
    names: tuple[str, ...]
    rate_hz: float
    positions: FloatArray

    def at(self, times_s: FloatArray) -> FloatArray:
        """Return positions (T, M, 3) at times (T,), s, since the first frame, interpolated linearly.

        NaN outside the frames, and where an adjacent frame lacks the marker.
        """
        rows = np.round(times_s * self.rate_hz, 6)
        low = np.floor(rows).astype(int)
        inside = (low >= 0) & (rows <= len(self.positions) - 1)
        before = self.positions[np.where(inside, low, 0)]
        after = self.positions[np.where(inside, np.ceil(rows).astype(int), 0)]
        fraction = (rows - low)[:, None, None]
        interpolated = np.where(fraction == 0.0, before, before + fraction * (after - before))
        return np.where(inside[:, None, None], interpolated, np.nan)


def read_markers(
    path: str | Path, unit: str | None = None, up: str | None = None, forward: str | None = None
) -> Markers:
    """Return the markers of a .trc or .c3d file, of a table of Qualisys, Motive or Vicon Nexus, or of our own, with
    gaps; unit, up and forward as in `in_world`.

    Raises InputError if the file cannot be read; with the line, for a TRC file.
    """
    path, readers = expanded(path), {".trc": read_trc, ".c3d": read_c3d, ".csv": _read_table, ".tsv": _read_table}
    if path.suffix.lower() not in readers:
        raise InputError(f"{path}: expected a marker file with the extension {' or '.join(readers)}")
    return in_world(str(path), readers[path.suffix.lower()](path), unit, up, forward)


def _read_table(path: Path) -> RawMarkers:
    lines = read_lines(path)
    return laboratory_markers(path, lines) if is_laboratory_table(lines) else joints_of_csv(path, lines)


def in_world(
    source: str, raw: RawMarkers, unit: str | None = None, up: str | None = None, forward: str | None = None
) -> Markers:
    """Return markers in metres with z up, NaN where the file has a gap or 0 0 0, without a model's outputs.

    A marker that is frozen in most of the frames is omitted, with a warning, and one that is never measured.

    Parameters
    ----------
    source : the file, for messages.
    raw : markers in the file's unit and axes.
    unit : of length, one of `units.UNITS`; None: the header's, if the person then has a plausible size.
    up, forward : the file's axes that become the world's z and x; None: by the person's posture, and `world_axes`.

    Raises
    ------
    InputError : no marker is measured, the person has no plausible size in any unit, or the vertical axis is unclear.
    """
    chosen = [k for k, name in enumerate(raw.names) if not _OUTPUT.search(plain_name(name))]
    names, positions = [raw.names[k] for k in chosen], raw.positions[:, chosen]
    positions = np.where((positions == 0.0).all(axis=-1, keepdims=True), np.nan, positions)
    if not np.isfinite(positions).any():
        raise InputError(f"{source}: expected markers, found none in {len(positions)} frames")
    for k in np.flatnonzero(frozen_markers(positions)):
        log.warning("%s: marker %s stands still in most frames while all others move; omitted", source, names[k])
        positions[:, k] = np.nan
    measured = np.isfinite(positions).any(axis=(0, 2))  # others are only announced, as Cortex' virtual markers
    names, positions = np.array(names)[measured].tolist(), positions[:, measured]
    joints = {
        joint: np.mean([positions[:, names.index(name)] for name in markers], axis=0)
        for joint, markers in marker_joints(names, source).items()
    }
    size = stature(joints)
    if size is None and not raw.unit:  # by the markers' extent
        seen = positions[np.isfinite(positions[..., 0]).any(axis=1)]
        size = float(np.median(np.linalg.norm(np.nanmax(seen, axis=1) - np.nanmin(seen, axis=1), axis=1)))
    metres = metres_per_unit(source, size, raw.unit, unit, is_stated=True)
    parts = {name: positions[:, k] for k, name in enumerate(names)}
    vertical = vertical_axis(source, upward(parts), raw.up, up)
    axes = world_axes(vertical, forward or (raw.forward if vertical == "y" else None))
    world = axes.vectors(positions) * metres
    check_places(source, world)
    return Markers(source, tuple(names), raw.rate_hz, world)


def frozen_markers(positions: FloatArray) -> BoolArray:
    """Return which markers (M,) alone keep their place, at positions (F, M, 3), in most of the frames."""
    measured = np.isfinite(positions[1:, :, 0]) & np.isfinite(positions[:-1, :, 0])
    still = (positions[1:] == positions[:-1]).all(axis=-1)
    alone = still & (still.sum(axis=1, keepdims=True) == 1) & (measured.sum(axis=1, keepdims=True) > 1)
    n_steps = measured.sum(axis=0)
    return np.asarray((n_steps >= _MIN_STEPS) & (alone.sum(axis=0) > _FROZEN * n_steps))


def joints_of(markers: Markers, assigned: MarkersOf = NO_MARKERS) -> list[tuple[str, tuple[str, ...]]]:
    """Return the joints of the markers, each with the names of the markers at whose mean it is.

    assigned : markers by joint, where their names do not determine it or the joint's centre is between other markers.
    Raises InputError for unknown joints or markers, and if no joint is identified.
    """
    if unknown := sorted(set(assigned) - set(JOINT_NAMES)):
        raise InputError(f"{markers.source}: unknown joint {unknown[0]!r}, expected one of {', '.join(JOINT_NAMES)}")
    if unknown := sorted({name for names in assigned.values() for name in names} - set(markers.names)):
        raise InputError(f"{markers.source}: no marker {unknown[0]!r}, expected some of {', '.join(markers.names)}")
    found = marker_joints(markers.names, markers.source) | {joint: tuple(names) for joint, names in assigned.items()}
    if not found:
        raise InputError(
            f"{markers.source}: no marker has the name of a joint, found {', '.join(markers.names[:60])}; name them by "
            "the key joint_markers"
        )
    return [(joint, found[joint]) for joint in JOINT_NAMES if joint in found]


def joint_centres(markers: Markers, positions: FloatArray, assigned: MarkersOf = NO_MARKERS) -> FloatArray:
    """Return the joint centres (F, J, 3), m, of markers at positions (F, M, 3); NaN where unknown; see `joints_of`.

    Hips without a marker, and the pelvis between them, are found by markers on the pelvis, see `hip_centres`.
    """
    centres = np.full((len(positions), len(JOINT_NAMES), 3), np.nan)

    def middle(names: Sequence[str]) -> FloatArray:
        return np.asarray(positions[:, [markers.names.index(name) for name in names]].mean(axis=1))

    joints = dict(joints_of(markers, assigned))
    for joint, names in joints.items():
        centres[:, JOINT_NAMES.index(joint)] = middle(names)
    if not set(_HIPS) & set(joints) and (pelvis := pelvis_markers(markers.names)):
        (left, right), back = pelvis
        hips = hip_centres(middle([left]), middle([right]), middle(back))
        centres[:, [JOINT_NAMES.index(hip) for hip in _HIPS]] = hips
        if "pelvis" not in joints:
            centres[:, JOINT_NAMES.index("pelvis")] = hips.mean(axis=1)
    return centres
