"""Markers of TRC files and of our own tables: their names, times, unit and positions as they are in the file."""

import logging
import re
from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np

from workbench.body.skeleton import FOOT_POINTS, JOINT_NAMES
from workbench.motion.formats.text import (
    MISSING,
    fail,
    gap_numbers,
    number_rows,
    numbers,
    points,
    read_lines,
    report_count,
)
from workbench.utils import input_limits
from workbench.utils.arrays import FloatArray
from workbench.utils.input_limits import MAX_NUMBERS, check_number, check_rate

log = logging.getLogger(__name__)

_HEADER_LINES = 12  # within which the labels of the columns are
_AXES = re.compile(r"""[\s,;"]*[XYZxyz]""")  # of the line below the labels
_ON_GRID = 0.3  # of a frame: larger deviations of the times from equal intervals are interpolated
_SAME_RATE = 0.01


class RawMarkers(NamedTuple):
    """Markers at equal intervals, in a file's unit and axes. positions : (F, M, 3), NaN in gaps. up : the vertical axis
    by the header, or None. forward : the axis that is the world's x where the file is the workbench's own, or None."""

    names: list[str]
    rate_hz: float
    positions: FloatArray
    unit: str
    up: str | None = None
    forward: str | None = None


def read_trc(path: Path) -> RawMarkers:
    """Return the markers of a TRC file, separated by tabs, semicolons, commas or blanks, with decimal points or commas.

    The times are those of the columns Frame# and Time: missing rows are gaps, and rows at unequal intervals are
    interpolated at the median rate. Where DataRate contradicts them, Time is used, with a warning. Raises InputError,
    with the line, for other content.
    """
    lines = read_lines(path)
    if not lines[0].strip().strip('"').startswith("PathFileType"):
        fail(path, 1, "expected a TRC file, whose first word is PathFileType")
    starts = [re.split(r"[\t,; ]", line.strip().lower(), maxsplit=1)[0].strip('"') for line in lines[:_HEADER_LINES]]
    labels = next((k for k, word in enumerate(starts) if word in ("frame#", "frame")), None)
    if labels is None:
        fail(path, min(4, len(lines)), "expected the columns Frame#, Time and the names of markers")
    delimiter = next((mark for mark in "\t;," if mark in lines[labels]), None)
    header: dict[str, str] = {}
    if "datarate" in starts[:labels]:
        keys, row, *_ = [line for line in [*lines[starts.index("datarate") : labels], ""] if line.strip()] + [""]
        header = _header(path, _cells(keys, delimiter), _cells(row, delimiter))
    names = [cell for cell in _cells(lines[labels], delimiter)[2:] if cell]
    if not names:
        fail(path, labels + 1, "expected the names of markers, found none")
    check_number(path, "markers", len(names), input_limits.MAX_JOINTS)
    if repeated := [name for k, name in enumerate(names) if name in names[:k]]:
        log.warning("%s: several markers are called %s; the first is used", path, ", ".join(repeated))
    numbered = enumerate(lines[labels + 1 :], labels + 2)
    table = [(line, text) for line, text in numbered if text.strip() and not _AXES.match(text)]
    if _is_cut(table, delimiter):
        log.warning("%s, line %d: the row is cut off; left out", path, table.pop()[0])
    check_number(path, "frames", len(table), input_limits.MAX_FRAMES)
    check_number(path, "coordinates", 3 * len(table) * len(names), MAX_NUMBERS)
    if not table:
        fail(path, len(lines), "expected a frame, found none")
    size = 3 * len(names)
    values = number_rows(table, 2 + size, delimiter, lambda k: _row(path, *table[k], delimiter, size), may_end=True)
    times = [_cells(text, delimiter, 2)[1:2] for _, text in table]
    digits = max(len(time.replace(",", ".").partition(".")[2]) for cells in times for time in cells)
    rate_cell = points([header.get("DataRate", "")])
    header_hz = numbers(path, labels, rate_cell, 1, "DataRate")[0] if rate_cell[0].lower() not in MISSING else None
    rate_hz, rows = _timing(path, values[:, 0], values[:, 1], 0.5 * 10.0**-digits, header_hz or None)
    check_rate(f"{path}: the rate", rate_hz)
    positions = values[:, 2:].reshape(len(values), -1, 3)
    if n_frames := re.fullmatch(r"(\d{1,9})(\.0*)?", header.get("NumFrames", "")):
        announced = int(n_frames[1])
        report_count(path, announced, len(table) if announced != round(rows[-1]) + 1 else announced)
    is_own = tuple(names[: len(JOINT_NAMES)]) == JOINT_NAMES and set(names[len(JOINT_NAMES) :]) <= set(FOOT_POINTS)
    forward = "x" if is_own else None  # as of OpenSim and `trc_text`
    return RawMarkers(names, rate_hz, at_grid(path, rows, positions), header.get("Units", ""), forward=forward)


def joints_of_csv(path: Path, lines: Sequence[str]) -> RawMarkers:
    """Return the joints in the lines of a CSV table of `motion_export.csv_text`: columns frame, time_s and <joint>_x_m,
    _y_m, _z_m.

    Rows are as in `read_trc`; other columns, as the pose's with its root_x_m, are ignored. Raises InputError, with the
    line, for other content.
    """
    columns = _cells(lines[0], ",")
    names = [column.removesuffix("_x_m") for column in columns if column.endswith("_x_m") and column != "root_x_m"]
    wanted = ["frame", "time_s", *[f"{name}_{axis}_m" for name in names for axis in "xyz"]]
    if not names or not set(wanted) <= set(columns):
        fail(path, 1, "expected the columns frame, time_s and <joint>_x_m, _y_m, _z_m")
    table = [(line, text) for line, text in enumerate(lines[1:], 2) if text.strip()]
    check_number(path, "frames", len(table), input_limits.MAX_FRAMES)
    check_number(path, "coordinates", len(table) * len(columns), MAX_NUMBERS)
    if not table:
        fail(path, len(lines), "expected a frame, found none")

    def row(k: int) -> list[float]:
        return gap_numbers(path, table[k][0], _cells(table[k][1], ","), len(columns), "a frame")

    values = number_rows(table, len(columns), ",", row)[:, [columns.index(column) for column in wanted]]
    time = columns.index("time_s")
    digits = max(len(_cells(text, ",", time + 1)[time].partition(".")[2]) for _, text in table)
    rate_hz, at = _timing(path, values[:, 0], values[:, 1], 0.5 * 10.0**-digits, None if len(values) > 1 else 1.0)
    check_rate(f"{path}: the rate", rate_hz)
    return RawMarkers(names, rate_hz, at_grid(path, at, values[:, 2:].reshape(len(values), -1, 3)), "m", "z")


def _cells(text: str, delimiter: str | None, at_most: int = -1) -> list[str]:
    """Return the cells of a line, which blanks may separate instead of the file's delimiter; after `at_most` the rest
    is one."""
    return [cell.strip().strip('"') for cell in text.split(delimiter if _has(delimiter, text) else None, at_most)]


def _has(delimiter: str | None, text: str) -> bool:
    return delimiter is not None and delimiter in text.strip()


def _header(path: Path, keys: list[str], row: list[str]) -> dict[str, str]:
    """Return the values of the header's keys, between which there may be several delimiters."""
    names, present = [key for key in keys if key], [cell for cell in row if cell]
    return dict(zip(names, present, strict=True) if len(names) == len(present) else zip(keys, row, strict=False))


def _is_cut(table: Sequence[tuple[int, str]], delimiter: str | None) -> bool:
    """Return whether the last row has fewer cells than any other, as that of a file whose end is missing."""
    n_others = min((text.count(delimiter) for _, text in table[:-1]), default=0) if delimiter else 0
    return n_others > 0 and len(_cells(table[-1][1], delimiter)) <= n_others


def _row(path: Path, line: int, text: str, delimiter: str | None, size: int) -> list[float]:
    """Return number, time and coordinates (2 + size,) of a frame, NaN for missing ones; trailing ones may be absent,
    unless blanks separate the cells."""
    cells, is_blank = _cells(text.rstrip(), delimiter, size + 2), not _has(delimiter, text)
    while len(cells) > 2 and not cells[-1]:
        cells = cells[:-1]
    if len(cells) > size + 2:
        fail(path, line, f"expected {size} coordinates, found {len(cells) - 2}")
    if is_blank and len(cells) < size + 2:
        fail(path, line, f"expected {size} coordinates, found {len(cells) - 2}; blanks leave no place for gaps")
    cells = [*points(cells), *[""] * (size + 2 - len(cells))]
    return gap_numbers(path, line, cells, size + 2, "coordinates")


def _timing(
    path: Path, frames: FloatArray, times_s: FloatArray, half_digit_s: float, header_hz: float | None
) -> tuple[float, FloatArray]:
    """Return the rate, Hz, and the position of every row in units of 1/rate after the first; whole on a grid."""
    number, time_s = frames - frames[0], times_s - times_s[0]
    has_numbers, has_times = (bool((np.diff(column) > 0.0).all()) for column in (number, time_s))
    if frames[0] > 1:
        log.warning("%s: the first row is frame %g at %g s; it is used as the first frame", path, frames[0], times_s[0])
    if header_hz is not None and (len(frames) == 1 or not has_times):
        if len(frames) > 1:
            log.warning("%s: the times do not increase; rows are %g Hz apart by DataRate", path, header_hz)
        return header_hz, number if has_numbers else np.arange(len(frames), dtype=float)
    if not has_times or len(frames) == 1:
        fail(path, 1, "expected a DataRate, or times that increase")
    if header_hz and abs(np.median(np.diff(time_s)) * header_hz / 1000.0 - 1.0) < _SAME_RATE:
        log.warning("%s: the times are read in milliseconds, by which they agree with DataRate", path)
        time_s = time_s / 1000.0
    if header_hz and has_numbers and (np.abs(time_s - number / header_hz) <= 0.5 / header_hz + half_digit_s).all():
        return header_hz, number
    rows = np.round(time_s / np.median(np.diff(time_s)))
    rate_hz = float(np.sum(rows**2) / np.sum(rows * time_s))
    if round(rate_hz) and abs(time_s[-1] - rows[-1] / round(rate_hz)) <= 2.0 * half_digit_s:
        rate_hz = float(round(rate_hz))
    if header_hz is not None and abs(rate_hz / header_hz - 1.0) > _SAME_RATE:
        log.warning("%s: DataRate is %g Hz, but the times are of %.6g Hz, which is used", path, header_hz, rate_hz)
    on_grid = (np.abs(time_s * rate_hz - rows) < _ON_GRID).all() and (np.diff(rows) > 0.0).all()
    if not on_grid:
        log.warning("%s: rows at unequal times; positions are interpolated at %.6g Hz", path, rate_hz)
    return rate_hz, rows if on_grid else time_s * rate_hz


def at_grid(path: Path, rows: FloatArray, positions: FloatArray) -> FloatArray:
    """Return positions (G, M, 3) at 0, 1, … of those (F, M, 3) at increasing `rows` (F,), NaN more than 1.5 from the
    next row and next to a gap; logged."""
    n = int(np.floor(rows[-1] + 1e-9)) + 1
    check_number(path, "frames", n, input_limits.MAX_FRAMES)
    check_number(path, "coordinates", n * positions[0].size, MAX_NUMBERS)
    if n > len(rows):
        log.warning("%s: %d of %d frames are missing; they are gaps", path, n - len(rows), n)
    grid = np.arange(n)
    low = np.clip(np.searchsorted(rows, grid + 1e-9, side="right") - 1, 0, len(rows) - 1)
    high = np.clip(np.searchsorted(rows, grid - 1e-9), 0, len(rows) - 1)
    width = rows[high] - rows[low]
    mixed, between = positions[low], np.flatnonzero(width > 0.0)
    fraction = ((grid - rows[low]) / np.maximum(width, 1e-9))[between, None, None]
    mixed[between] = (1.0 - fraction) * positions[low[between]] + fraction * positions[high[between]]
    mixed[width > 1.5] = np.nan
    return mixed
