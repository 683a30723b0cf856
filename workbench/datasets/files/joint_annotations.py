"""Joints marked by hand or found by a detector in a video, from a CSV file or OpenPose's JSON files."""

import csv
import logging
import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from workbench.body.skeleton import JOINT_NAMES
from workbench.datasets.association.target_selection import Followed, follow
from workbench.motion.formats.openpose import People, read_openpose
from workbench.utils.arrays import BoolArray, FloatArray, IntArray
from workbench.utils.errors import InputError
from workbench.utils.input_limits import LARGEST_PX, check_file

log = logging.getLogger(__name__)

COLUMNS = ("frame", "joint", "u", "v", "visible")


@dataclass(frozen=True, eq=False)
class Marks:
    """Marks in M frames of one video. source: the file they come from. frames: (M,) numbers of the frames in their
    video, rising. pixels: (M, J, 2) marks [u, v] in the full-size image, the centre of the top left pixel being (0, 0),
    NaN for joints without a mark, in the order of JOINT_NAMES. visible: (M, J), false for a mark on a hidden joint, and
    where there is no mark. confidence: (M, J) of a detector, 0..1, NaN where there is no mark; None for marks by
    hand. counted: what `Followed` counts of whom a detector found."""

    source: str
    frames: IntArray
    pixels: FloatArray
    visible: BoolArray
    confidence: FloatArray | None = None
    counted: Mapping[str, int] = field(default_factory=dict)

    def at(self, frame: int) -> tuple[FloatArray, BoolArray] | None:
        """Pixels (J, 2) and visibility (J,) of the marks in a frame; None where it has none."""
        if frame not in self.frames:
            return None
        row = int(np.searchsorted(self.frames, frame))
        return self.pixels[row], self.visible[row]

    def weighted(self, frame: int, hidden_weight: float) -> FloatArray | None:
        """The marks (J, 3) in a frame, [u, v, weight]: a detector's confidence, or 1, where hidden hidden_weight."""
        if frame not in self.frames:
            return None
        row = int(np.searchsorted(self.frames, frame))
        weights = np.where(self.visible[row], 1.0, hidden_weight) if self.confidence is None else self.confidence[row]
        return np.column_stack([self.pixels[row], np.where(np.isnan(self.pixels[row, :, 0]), np.nan, weights)])

    def rows(self, kept: BoolArray) -> "Marks":
        """Select those of the frames `kept` (M,)."""
        confidence = None if self.confidence is None else self.confidence[kept]
        return Marks(self.source, self.frames[kept], self.pixels[kept], self.visible[kept], confidence, self.counted)


def read_marks(
    path: str | Path, person: int | None = None, rate_hz: float = 30.0, within: tuple[int, int | None] = (0, None)
) -> Marks:
    """Read a CSV file, or a folder of OpenPose's files: one person in it at `rate_hz`, see `follow` for `person` and
    `within`. The CSV file has the columns frame, joint, u, v, visible, in any order; visible is 0 or 1. Raises
    InputError as `read_openpose` and `follow` do, and, naming the file and the line, for a missing or empty file,
    missing or unknown columns, an unknown joint, what is not a number, and a second mark on the same joint in the same
    frame."""
    path = Path(path)
    if path.is_dir():
        people = read_people(path)
        return followed_marks(people, follow({path.name: people}, None, rate_hz, person, within), 0)
    marks: dict[tuple[int, str], tuple[int, float, float, bool]] = {}
    for line, row in _rows(path):
        frame, joint, u, v, visible = _parse(f"{path}:{line}", row)
        if (frame, joint) in marks:
            before = marks[frame, joint][0]
            raise InputError(f"{path}:{line}: {joint} of frame {frame} is already marked in line {before}")
        marks[frame, joint] = line, u, v, visible
    if not marks:
        raise InputError(f"{path}: expected at least one mark under the header {','.join(COLUMNS)}, found none")
    frames = sorted({frame for frame, _ in marks})
    pixels, shown = np.full((len(frames), len(JOINT_NAMES), 2), np.nan), np.zeros((len(frames), len(JOINT_NAMES)), bool)
    for (frame, joint), (_, u, v, visible) in marks.items():
        place = frames.index(frame), JOINT_NAMES.index(joint)
        pixels[place], shown[place] = (u, v), visible
    return Marks(str(path), np.array(frames), pixels, shown)


def read_people(folder: str | Path) -> People:
    """Read a folder of OpenPose's files, and say in the log what is in it."""
    people = read_openpose(folder)
    log.info("%s: %s, %d frames", folder, people.layout, len(people.frames))
    return people


def followed_marks(people: People, followed: Followed, view: int) -> Marks:
    """Return what a view's files show of the person followed."""
    own = np.isin(followed.frames, people.frames)
    pixels, confidence = followed.joints[view][own, :, :2], followed.joints[view][own, :, 2]
    frames = followed.frames[own]
    return Marks(people.source, frames, pixels, np.isfinite(confidence), confidence, followed.counted)


def _rows(path: Path) -> Iterator[tuple[int, dict[str, str]]]:
    """Line numbers and cells, by column, of the rows that are not blank."""
    if not path.exists():
        raise InputError(f"{path}: no such file of marks")
    check_file(path)
    try:
        text = path.read_text(encoding="utf-8-sig")
    except (OSError, UnicodeDecodeError) as error:
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
                raise InputError(f"{path}:{reader.line_num}: expected {len(header)} cells, found {len(cells)}")
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
    if abs(value) > LARGEST_PX:
        raise InputError(f"{place}: {name} must lie within {LARGEST_PX:g} px, found {cell!r}")
    return value
