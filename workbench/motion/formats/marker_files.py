"""Readers of files with markers: TRC, and C3D by ezc3d (the extra `c3d`)."""

from pathlib import Path

import numpy as np

from workbench.motion.formats.c3d import read_points
from workbench.motion.formats.markers import Markers, in_world
from workbench.motion.formats.text import fail, numbers, read_lines
from workbench.utils.errors import InputError
from workbench.utils.input_limits import MOST_FRAMES, MOST_JOINTS, MOST_NUMBERS, check_number, check_rate

_FIRST_ROW = 5  # of a TRC file, after three lines of header and two of column labels; `export` writes them


def read_markers(path: str | Path) -> Markers:
    """Read the markers of a .trc or .c3d file, with gaps; unit and axes: see `in_world`.

    Raises InputError for what cannot be read, with the line in a TRC file.
    """
    path, readers = Path(path).expanduser(), {".trc": _read_trc, ".c3d": _read_c3d}
    if path.suffix.lower() not in readers:
        raise InputError(f"{path}: expected a file of markers that ends in {' or '.join(readers)}")
    return readers[path.suffix.lower()](path)


def _read_trc(path: Path) -> Markers:
    lines = read_lines(path)
    if len(lines) <= _FIRST_ROW or not lines[0].startswith("PathFileType"):
        fail(path, 1, "expected a TRC file, which begins with PathFileType")
    header = dict(zip(lines[1].split("\t"), lines[2].split("\t"), strict=False))
    (rate_hz,) = numbers(path, 3, [header.get("DataRate", "").strip()], 1, "DataRate")
    if not rate_hz > 0.0:
        fail(path, 3, f"expected a DataRate above zero, found {rate_hz:g}")
    check_rate(f"{path}, line 3: DataRate", rate_hz)
    names = [cell.strip() for cell in lines[3].split("\t")[2:] if cell.strip()]
    if not names or len(set(names)) < len(names):
        fail(path, 4, f"expected the names of markers, all different, found {', '.join(names)!r}")
    if len(names) > MOST_JOINTS:
        fail(path, 4, f"expected at most {MOST_JOINTS} markers, found {len(names)}")
    table = [(line, text) for line, text in enumerate(lines[_FIRST_ROW:], start=_FIRST_ROW + 1) if text.strip()]
    check_number(path, "frames", len(table), MOST_FRAMES)
    check_number(path, "coordinates", 3 * len(table) * len(names), MOST_NUMBERS)
    rows = [_row(path, line, text, len(names)) for line, text in table]
    if not rows:
        fail(path, len(lines), "expected a frame, found none")
    positions = np.array(rows).reshape(len(rows), len(names), 3)
    return in_world(str(path), names, rate_hz, positions, header.get("Units", "").strip())


def _row(path: Path, line: int, text: str, n_markers: int) -> list[float]:
    """Three numbers a marker, NaN for a blank or nan; blanks at the end may be missing."""
    cells = [cell.strip() for cell in text.split("\t")]
    values = [*cells[2:], *[""] * (2 + 3 * n_markers - len(cells))]
    while len(values) > 3 * n_markers and not values[-1]:
        values.pop()
    if len(values) != 3 * n_markers:
        fail(path, line, f"expected {3 * n_markers} coordinates, found {len(values)}")
    known = [value for value in values if value.lower() not in ("", "nan")]
    found = iter(numbers(path, line, known, len(known), "coordinates"))
    return [next(found) if value.lower() not in ("", "nan") else np.nan for value in values]


def _read_c3d(path: Path) -> Markers:
    names, rate_hz, positions, unit = read_points(path)
    if not names or not rate_hz > 0.0 or positions.shape[1:] != (len(names), 3):
        raise InputError(f"{path}: expected labelled points at a rate, found {len(names)} labels at {rate_hz:g} Hz")
    return in_world(str(path), names, rate_hz, positions, unit)
