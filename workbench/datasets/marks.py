"""Joints marked by hand in a video, from a CSV file."""

import csv
import math
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from workbench.arrays import BoolArray, FloatArray, IntArray
from workbench.body.skeleton import JOINT_NAMES
from workbench.errors import InputError

COLUMNS = ("frame", "joint", "u", "v", "visible")


@dataclass(frozen=True, eq=False)
class Marks:
    """Marks in M frames of one video.

    source: the file they come from. frames: (M,) numbers of the frames in their video, rising. pixels: (M, J, 2) marks
    [u, v] in the full-size image, the centre of the top left pixel being (0, 0), NaN for joints without a mark, in
    the order of JOINT_NAMES. visible: (M, J), false for a mark on a hidden joint, and where there is no mark.
    """

    source: str
    frames: IntArray
    pixels: FloatArray
    visible: BoolArray

    def at(self, frame: int) -> tuple[FloatArray, BoolArray] | None:
        """Pixels (J, 2) and visibility (J,) of the marks in a frame; None where it has none."""
        if frame not in self.frames:
            return None
        row = int(np.searchsorted(self.frames, frame))
        return self.pixels[row], self.visible[row]


def read_marks(path: str | Path) -> Marks:
    """Read a CSV file with the columns frame, joint, u, v, visible, in any order; visible is 0 or 1.

    Raises InputError, naming the file and the line, for a missing or empty file, missing or unknown columns, an
    unknown joint, what is not a number, and a second mark on the same joint in the same frame.
    """
    path = Path(path)
    seen: dict[tuple[int, str], int] = {}
    rows: dict[int, list[tuple[int, float, float, bool]]] = {}
    for line, row in _rows(path):
        frame, joint, u, v, visible = _parse(f"{path}:{line}", row)
        if (frame, joint) in seen:
            raise InputError(f"{path}:{line}: {joint} of frame {frame} is already marked in line {seen[frame, joint]}")
        seen[frame, joint] = line
        rows.setdefault(frame, []).append((JOINT_NAMES.index(joint), u, v, visible))
    if not rows:
        raise InputError(f"{path}: expected at least one mark under the header {','.join(COLUMNS)}, found none")
    frames = sorted(rows)
    pixels = np.full((len(frames), len(JOINT_NAMES), 2), np.nan)
    visible_joints = np.zeros((len(frames), len(JOINT_NAMES)), dtype=bool)
    for m, frame in enumerate(frames):
        for j, u, v, visible in rows[frame]:
            pixels[m, j], visible_joints[m, j] = (u, v), visible
    return Marks(str(path), np.array(frames), pixels, visible_joints)


def _rows(path: Path) -> Iterator[tuple[int, dict[str, str]]]:
    """Line numbers and cells, by column, of the rows that are not blank."""
    try:
        text = path.read_text(encoding="utf-8-sig")
    except (FileNotFoundError, IsADirectoryError):
        raise InputError(f"{path}: no such file of marks") from None
    except UnicodeDecodeError as error:
        raise InputError(f"{path}: expected a text file of marks: {error}") from None
    reader = csv.reader(text.splitlines())
    try:
        header = [cell.strip() for cell in next(reader, [])]
        if sorted(header) != sorted(COLUMNS):
            raise InputError(f"{path}:1: expected the columns {','.join(COLUMNS)}, found {','.join(header)!r}")
        for cells in reader:
            if not any(cell.strip() for cell in cells):
                continue
            if len(cells) != len(header):
                place = f"{path}:{reader.line_num}"
                raise InputError(f"{place}: expected {len(header)} cells, found {len(cells)}")
            yield reader.line_num, {name: cell.strip() for name, cell in zip(header, cells, strict=True)}
    except csv.Error as error:
        raise InputError(f"{path}:{reader.line_num}: {error}") from None


def _parse(place: str, row: dict[str, str]) -> tuple[int, str, float, float, bool]:
    if not (row["frame"].isascii() and row["frame"].isdigit() and len(row["frame"]) < 10):
        raise InputError(f"{place}: expected a frame's number, found {row['frame']!r}")
    if row["joint"] not in JOINT_NAMES:
        raise InputError(f"{place}: unknown joint {row['joint']!r}, expected one of {', '.join(JOINT_NAMES)}")
    if row["visible"] not in ("0", "1"):
        raise InputError(f"{place}: visible must be 0 or 1, found {row['visible']!r}")
    u, v = _pixel(place, "u", row["u"]), _pixel(place, "v", row["v"])
    return int(row["frame"]), row["joint"], u, v, row["visible"] == "1"


def _pixel(place: str, name: str, cell: str) -> float:
    try:
        value = float(cell)
    except ValueError:
        value = math.nan
    if not math.isfinite(value):
        raise InputError(f"{place}: {name} must be a number of pixels, found {cell!r}")
    return value
