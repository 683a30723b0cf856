"""Marks as they are made: set, removed, undone, and kept in a file after every one of them."""

from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from workbench.body.skeleton import JOINT_NAMES
from workbench.datasets.files.marks import COLUMNS, read_marks
from workbench.errors import InputError
from workbench.files import whole_file

Mark = tuple[float, float, bool]
"""u and v, px, the centre of the top left pixel being (0, 0), and whether the joint is visible there."""


@dataclass
class Table:
    """Marks of a video of n_frames frames of a size (width, height), px, kept in a file of the columns that
    `datasets.files.marks` reads. marks: by frame and joint. undoing: what to put back, the latest last."""

    path: Path
    n_frames: int
    size: tuple[int, int]
    marks: dict[tuple[int, str], Mark] = field(default_factory=dict)
    undoing: list[tuple[tuple[int, str], Mark | None]] = field(default_factory=list)

    def put(self, frame: int, joint: str, mark: Mark | None) -> None:
        """Set a mark, or remove it, and write the file. Raises InputError for a frame or joint that there is not, a
        place outside the image, and where the file cannot be written; then nothing has changed."""
        self._check(frame, joint, mark)
        before = self.marks.get((frame, joint))
        self._replace((frame, joint), mark)
        self.undoing.append(((frame, joint), before))

    def undo(self) -> tuple[int, str] | None:
        """Take back the latest change since the table was opened, write the file, and return where it was; None where
        there is none."""
        if not self.undoing:
            return None
        place, before = self.undoing[-1]
        self._replace(place, before)
        self.undoing.pop()
        return place

    def by_frame(self) -> dict[int, dict[str, Mark]]:
        """Return the marks by joint by frame, in order."""
        found: dict[int, dict[str, Mark]] = {}
        for frame, joint in sorted(self.marks, key=lambda place: (place[0], JOINT_NAMES.index(place[1]))):
            found.setdefault(frame, {})[joint] = self.marks[frame, joint]
        return found

    def _replace(self, place: tuple[int, str], mark: Mark | None) -> None:
        """Put a mark in its place and write the file, or leave all as it was."""
        before = dict(self.marks)
        self.marks.pop(place, None)
        if mark is not None:
            self.marks[place] = mark
        try:
            self._write()
        except InputError:
            self.marks = before
            raise

    def _write(self) -> None:
        rows = [",".join(COLUMNS)]
        for frame, joints in self.by_frame().items():
            rows += [f"{frame},{joint},{_number(u)},{_number(v)},{int(seen)}" for joint, (u, v, seen) in joints.items()]
        with whole_file(self.path) as part:
            part.write_text("\n".join(rows) + "\n", encoding="utf-8")

    def _check(self, frame: int, joint: str, mark: Mark | None) -> None:
        if not 0 <= frame < self.n_frames:
            raise InputError(f"no frame {frame}, expected one of 0 to {self.n_frames - 1}")
        if joint not in JOINT_NAMES:
            raise InputError(f"unknown joint {joint!r}, expected one of {', '.join(JOINT_NAMES)}")
        if mark is not None and not all(-0.5 <= x <= side - 0.5 for x, side in zip(mark[:2], self.size, strict=True)):
            raise InputError(f"({mark[0]:g}, {mark[1]:g}) lies outside the image of {self.size[0]}×{self.size[1]} px")


def open_table(path: Path, n_frames: int, size: tuple[int, int]) -> Table:
    """Open a table, going on with the file's marks where it is there.

    Raises InputError as `read_marks` does, for marks of another video, and a folder in which nothing can be written.
    """
    if not path.parent.is_dir():
        raise InputError(f"{path}: expected a folder to write to, found none")
    table = Table(path, n_frames, size)
    if path.exists() and not _is_empty(path):
        found = read_marks(path)
        for frame, pixels, visible in zip(found.frames.tolist(), found.pixels, found.visible, strict=True):
            for j in np.flatnonzero(np.isfinite(pixels[:, 0])):
                mark = float(pixels[j, 0]), float(pixels[j, 1]), bool(visible[j])
                try:
                    table._check(frame, JOINT_NAMES[j], mark)
                except InputError as error:
                    raise InputError(f"{path}: marks of another video? {error}") from None
                table.marks[frame, JOINT_NAMES[j]] = mark
    return table


def mark_of(values: Any) -> tuple[int, str, Mark | None]:
    """Read {frame, joint, u, v, visible}, u and v being null to remove a mark; raises InputError for anything else."""
    keys = {"frame", "joint", "u", "v", "visible"}
    if not isinstance(values, dict) or set(values) != keys:
        raise InputError(f"expected {', '.join(sorted(keys))}, found others")
    frame, joint, u, v, visible = (values[key] for key in ("frame", "joint", "u", "v", "visible"))
    plain = type(frame) is int and isinstance(joint, str) and type(visible) is bool
    if plain and u is None and v is None:
        return frame, joint, None
    if plain and all(type(x) in (int, float) and np.isfinite(x) for x in (u, v)):
        return frame, joint, (float(u), float(v), visible)
    raise InputError("expected a frame's number, a joint's name, two numbers of pixels or null, and true or false")


def _is_empty(path: Path) -> bool:
    """Tell whether a file of marks has no rows, as one from which all marks were removed."""
    try:
        return path.read_text(encoding="utf-8-sig").strip() == ",".join(COLUMNS)
    except (OSError, UnicodeDecodeError):
        return False  # which reading it tells


def _number(value: float) -> str:
    return f"{value:.2f}".rstrip("0").rstrip(".")
