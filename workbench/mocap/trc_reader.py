"""The reader of TRC files: three lines of header, two of column labels, one line a frame; `trc` writes them."""

from pathlib import Path

import numpy as np

from workbench.mocap.markers import Markers, in_world
from workbench.mocap.text import fail, numbers, read_lines

_FIRST_ROW = 5


def read_trc(path: Path) -> Markers:
    """The markers of a TRC file, with gaps (blank or nan); unit and axes: see `in_world`.

    Raises InputError, with file and line, for what is no TRC file.
    """
    lines = read_lines(path)
    if len(lines) <= _FIRST_ROW or not lines[0].startswith("PathFileType"):
        fail(path, 1, "expected a TRC file, which begins with PathFileType")
    header = dict(zip(lines[1].split("\t"), lines[2].split("\t"), strict=False))
    (rate_hz,) = numbers(path, 3, [header.get("DataRate", "").strip()], 1, "DataRate")
    if not rate_hz > 0.0:
        fail(path, 3, f"expected a DataRate above zero, found {rate_hz:g}")
    names = [cell.strip() for cell in lines[3].split("\t")[2:] if cell.strip()]
    if not names or len(set(names)) < len(names):
        fail(path, 4, f"expected the names of markers, all different, found {', '.join(names)!r}")
    rows = [
        _row(path, line, text, len(names))
        for line, text in enumerate(lines[_FIRST_ROW:], start=_FIRST_ROW + 1)
        if text.strip()
    ]
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
