"""Markers in the tables of motion-capture programs: Qualisys' TSV, and the CSV of Motive and of Vicon Nexus.

Each has lines of names and axes above the columns; the readers differ in where these lines, the rate and the unit are.
"""

import csv
import re
from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np

from workbench.motion.formats.joint_names import skeleton_joints
from workbench.motion.formats.text import fail, gap_numbers, numbers, points
from workbench.motion.formats.trc import RawMarkers, at_grid
from workbench.utils import input_limits
from workbench.utils.input_limits import MAX_NUMBERS, check_number, check_rate

_QUALISYS, _MOTIVE, _VICON = "NO_OF_FRAMES", "Format Version", "Trajectories"
"""First cells of a table's first line, of Vicon's that of its section."""
_BONE = "Bone"
_MOTIVE_TYPES = (_BONE, "Marker", "Bone Marker", "Rigid Body Marker")
"""Types of Motive's columns with positions, the preferred first: joints, then measured markers."""
_UNLABELED = re.compile(r"unlabeled|\*", re.IGNORECASE)
_Rows = list[list[str]]


class _Table(NamedTuple):
    """Where a table's numbers are. begin, end : their lines, from 0. names, axes : by column; a name may be absent
    where it repeats. rate : its line and text, Hz. has_frames : whether the first column has the frames' numbers."""

    begin: int
    end: int
    names: Sequence[str]
    axes: Sequence[str]
    rate: tuple[int, str]
    unit: str
    has_frames: bool = True


def is_laboratory_table(lines: Sequence[str]) -> bool:
    """Return whether the lines of a file are a table of Qualisys, Motive or Vicon Nexus."""
    starts = [re.split(r"[\t,;]", line.strip('"'), maxsplit=1)[0].strip('" ') for line in lines]
    return starts[0] in (_QUALISYS, _MOTIVE) or _VICON in starts


def laboratory_markers(path: Path, lines: Sequence[str]) -> RawMarkers:
    """Return the markers in the lines of a table of Qualisys, Motive or Vicon Nexus, or the joints of a skeleton of
    Motive.

    Missing frames are gaps, unlabeled markers are ignored. Raises InputError, with the line, for other content.
    """
    rows = list(csv.reader(lines, delimiter=max("\t,;", key="\n".join(lines[:12]).count)))
    rows = [[cell.strip() for cell in row] for row in rows]
    find = {_QUALISYS: _qualisys, _MOTIVE: _motive}.get(rows[0][0] if rows[0] else "", _vicon)
    table = find(path, rows)
    columns: dict[str, dict[str, int]] = {}
    name = ""
    for k, axis in enumerate(table.axes):
        name = table.names[k] if k < len(table.names) and table.names[k] else name
        if name and axis.lower() in ("x", "y", "z") and not _UNLABELED.match(name):
            columns.setdefault(name, {}).setdefault(axis.lower(), k)
    columns = {name: axes for name, axes in columns.items() if len(axes) == len("xyz")}
    if not columns or table.begin >= table.end:
        fail(path, table.begin + 1, "expected columns X, Y and Z of named markers, and a row for each frame")
    check_number(path, "markers", len(columns), input_limits.MAX_JOINTS)
    check_number(path, "coordinates", 3 * len(columns) * (table.end - table.begin), MAX_NUMBERS)
    wanted = [0, *(axes[axis] for axes in columns.values() for axis in "xyz")]
    cells = [[row[k] if k < len(row) else "" for k in wanted] for row in rows[table.begin : table.end]]
    values = np.array([gap_numbers(path, k, points(row), len(wanted), "a frame")
                       for k, row in enumerate(cells, table.begin + 1)])  # fmt: skip
    (rate_hz,) = numbers(path, table.rate[0] + 1, points([table.rate[1]]), 1, "the rate")
    steps = np.diff(values[:, 0])
    has_frames = table.has_frames and len(steps) > 0 and bool((steps > 0.0).all())
    at = (values[:, 0] - values[0, 0]) / np.median(steps) if has_frames else np.arange(len(values), dtype=float)
    positions = at_grid(path, at, values[:, 1:].reshape(len(values), -1, 3))
    return RawMarkers(list(columns), check_rate(f"{path}: the rate", rate_hz), positions, table.unit)


def _qualisys(path: Path, rows: _Rows) -> _Table:
    """Keys with values, then frames of mm, with or without columns of the number and the time in front."""
    keys = {row[0]: k for k, row in enumerate(rows[:20]) if row}
    if not {"MARKER_NAMES", "FREQUENCY"} <= keys.keys():
        fail(path, 1, "expected FREQUENCY and MARKER_NAMES in Qualisys' table of 3-D markers")
    names = [name for name in rows[keys["MARKER_NAMES"]][1:] if name]
    begin = next((k for k, row in enumerate(rows) if row and re.fullmatch(r"[-+\d.,eE]+", row[0])), len(rows))
    n_front = len([*filter(None, rows[begin])]) - 3 * len(names) if begin < len(rows) else 0
    titles = begin > 0 and rows[begin - 1][:1] == ["Frame"]
    n_front = 2 if titles else max(n_front, 0)
    columns = [*[""] * n_front, *(name for name in names for _ in "xyz")]
    axes = [*[""] * n_front, *"xyz" * len(names)]
    rate = keys["FREQUENCY"]
    return _Table(begin, _end(rows, begin), columns, axes, (rate, "".join(rows[rate][1:2])), "mm", n_front > 0)


def _motive(path: Path, rows: _Rows) -> _Table:
    """Lines of types, names, identities and quantities above that of the axes, which begins with Frame."""
    header = dict(zip(rows[0][::2], rows[0][1::2], strict=False))
    last = next((k for k, row in enumerate(rows) if row[:1] == ["Frame"]), 0)
    above = [row for row in rows[1:last] if any(row)]
    if len(above) < 3:
        fail(path, last + 1, "expected lines of types, names and quantities of Motive's columns, and one with Frame")
    types, names, quantities = above[0], above[1], above[-1]
    shown = {kind for kind, quantity in zip(types, quantities, strict=False) if quantity == "Position"}
    chosen = next((kind for kind in _MOTIVE_TYPES if kind in shown), "")
    axes = [axis if types[k : k + 1] == [chosen] and quantities[k : k + 1] == ["Position"] else ""
            for k, axis in enumerate(rows[last])]  # fmt: skip
    if chosen == _BONE:  # in the order of the hierarchy, in which a limb's bones follow each other
        bones = list(dict.fromkeys(name for name, kind in zip(names, types, strict=False) if kind == _BONE))
        joints = {bone: joint for joint, bone in skeleton_joints(bones, range(-1, len(bones) - 1), place=path).items()}
        names = [joints.get(name, name) for name in names]
    rate = header.get("Export Frame Rate", header.get("Capture Frame Rate", ""))
    return _Table(last + 1, _end(rows, last + 1), names, axes, (0, rate), header.get("Length Units", ""))


def _vicon(path: Path, rows: _Rows) -> _Table:
    """A section of several, with its rate, and lines of names, axes and units above its frames."""
    start = next((k for k, row in enumerate(rows) if row[:1] == [_VICON]), len(rows))
    if start + 5 >= len(rows):
        fail(path, min(start, len(rows) - 1) + 1, "expected Trajectories, their rate, names, axes, units and frames")
    rate, names, axes, units = rows[start + 1 : start + 5]
    unit = next((unit for unit, axis in zip(units, axes, strict=False) if axis.lower() == "x"), "")
    return _Table(start + 5, _end(rows, start + 5), names, axes, (start + 1, "".join(rate[:1])), unit)


def _end(rows: _Rows, begin: int) -> int:
    """Return the line after the last one before an empty line."""
    return next((k for k in range(begin, len(rows)) if not any(rows[k])), len(rows))
