"""CSV tables of detected people: DeepLabCut's, and tables with a column for each coordinate of each point."""

import csv
import re
import string
from collections.abc import Iterable
from io import StringIO
from pathlib import Path

import numpy as np
import pandas as pd

from workbench.detections.readers.detected_points import DetectedPoints, keypoints_of, ordered_points
from workbench.detections.readers.formats import COORDINATES, FRAME_KEYS
from workbench.utils.arrays import FloatArray
from workbench.utils.errors import InputError
from workbench.utils.text import read_text

_DEEPLABCUT = ("scorer", "individuals", "bodyparts", "coords")
"""First cells of the header's lines."""
_COLUMN = re.compile(rf"(?:(.+?)[._ -])?({'|'.join(COORDINATES)})(?:[._ -]?(\d+))?", re.IGNORECASE)
"""A coordinate of a point: nose.x, nose_x, x_0, x0."""
_MAX_TABLE = 80_000_000
"""Bytes of a table, which takes up to fifteen times as much memory."""
_MIN_POINTS = 3
"""Points of a table of detected people, which tables of other contents do not have."""
_POINT_KEYS = tuple(f"{point}{suffix}" for suffix in ("_name", "", "_id", "_index") for point in (
    "landmark", "keypoint", "joint", "bodypart", "point", "points"
))  # fmt: skip
"""Columns of the point's name or number, the preferred first, in tables with a row for each point."""
_PERSON_KEYS = ("person_id", "person", "track_id", "track", "individual", "individuals")
_INVALID = (csv.Error, ValueError, KeyError, IndexError)


def is_table(path: Path) -> bool:
    """Return whether the first line of a CSV file is that of a table of detected people."""
    with path.open("rb") as file:
        line = file.readline(1 << 20).decode("utf-8-sig", "replace").strip()
    columns = [column.strip('"') for column in line.split(_separator(line))]
    return line.startswith("scorer,") or len(_points_of(columns)) >= _MIN_POINTS or _has_rows_of_points(columns)


def read_table(file: Path) -> DetectedPoints:
    """Return the points of a CSV table of detected people.

    A row is a person in the frame of a column of FRAME_KEYS, or without one in the next frame; or a point of a person.
    Commas, semicolons or tabs separate the columns.
    Raises InputError for other content.
    """
    text = read_text(file, _MAX_TABLE)
    if text.startswith("scorer,"):
        return _deeplabcut(file, text)
    separator = _separator(text.partition("\n")[0])
    try:
        content = StringIO(text if separator == "," else text.replace(",", "."))  # decimal commas
        table = pd.read_csv(content, sep=separator, skipinitialspace=True)
        table = _rows_of_people(table) if _has_rows_of_points(table.columns) else table
        if not (columns := _points_of(table.columns)):
            raise ValueError("found no columns x and y of a point, such as nose_x and nose_y")
        numbers = np.full((len(table), len(columns), 3), np.nan)
        for k, coordinates in enumerate(columns.values()):
            for coordinate, column in coordinates.items():
                numbers[:, k, coordinate] = table[column].to_numpy(dtype=np.float64)
    except _INVALID as error:
        raise InputError(f"{file}: expected numbers in the columns of points: {error}") from None
    missing = np.isnan(numbers[..., 2])  # of a point in all rows, or of all points of a person labelled by hand
    numbers[..., 2] = np.where(missing.all(axis=0) | missing.all(axis=1, keepdims=True), 1.0, numbers[..., 2])
    key = _column(table.columns, FRAME_KEYS)
    frames = map(str, range(len(table)) if key is None else table[key])
    by_frame: dict[str, list[FloatArray]] = {}
    try:
        for frame, points in zip(frames, numbers, strict=True):
            by_frame.setdefault(Path(frame.removesuffix(".0")).stem, []).append(keypoints_of(points))
    except ValueError as error:
        raise InputError(f"{file}: frame {frame}: {error}") from None
    names = () if _are_numbered(columns) else tuple(columns)
    return ordered_points(file, list(by_frame), list(by_frame.values()), names)


def _separator(line: str) -> str:
    """Return the separator of the columns that a line names."""
    return max(",;\t", key=line.count)


def _column(columns: Iterable[str], keys: Iterable[str]) -> str | None:
    """Return the first column that has one of the keys as its name, in any case."""
    names = {column.strip().lower(): column for column in columns}
    return next((names[key] for key in keys if key in names), None)


def _has_rows_of_points(columns: Iterable[str]) -> bool:
    """Return whether a table has a row for each point: columns of frame, point, x and y."""
    names = list(columns)
    return all(_column(names, keys) is not None for keys in (FRAME_KEYS, _POINT_KEYS, ("x",), ("y",)))


def _rows_of_people(table: pd.DataFrame) -> pd.DataFrame:
    """Return a table with a row for each point as one with a row for each person."""
    people = [column for keys in (FRAME_KEYS, _PERSON_KEYS) if (column := _column(table.columns, keys)) is not None]
    confidence = _column(table.columns, [name for name, k in COORDINATES.items() if k == 2])
    values = [_column(table.columns, ("x",)), _column(table.columns, ("y",)), *([confidence] if confidence else [])]
    wide = table.pivot(index=people, columns=_column(table.columns, _POINT_KEYS), values=values)
    wide.columns = pd.Index([f"{point}_{coordinate}" for coordinate, point in wide.columns])
    return wide.reset_index()


def _points_of(columns: Iterable[str]) -> dict[str, dict[int, str]]:
    """Return the columns by coordinate, 0 to 2, of the points that have both coordinates, by their names.

    Points whose names are numbers are in their order.
    """
    points: dict[str, dict[int, str]] = {}
    for column in columns:
        if (found := _COLUMN.fullmatch(column.strip())) and (name := found[1] or found[3]):
            known, letter = points.setdefault(name, {}), found[2].lower()
            known.setdefault(2 if letter == "v" and 1 in known else COORDINATES[letter], column)  # v: a visibility
    points = {name: coordinates for name, coordinates in points.items() if {0, 1} <= coordinates.keys()}
    return dict(sorted(points.items(), key=lambda item: _number(item[0]))) if _are_numbered(points) else points


def _are_numbered(names: Iterable[str]) -> bool:
    """Return whether the names of points are numbers, also after a word: landmark_3."""
    return len({name.rstrip(string.digits) for name in names}) == 1 and all(_number(name) >= 0 for name in names)


def _number(name: str) -> int:
    return int(re.findall(r"(\d*)$", name)[0] or -1)


def _deeplabcut(file: Path, text: str) -> DetectedPoints:
    """Return the points of DeepLabCut's file, of one individual or several: columns by body part and coordinate."""
    try:
        rows = [row for row in csv.reader(text.split("\n")) if any(row)]
        header = {row[0]: row for row in rows[: len(_DEEPLABCUT)] if row[0] in _DEEPLABCUT}
        body, coordinates = rows[len(header) :], header["coords"]
        first = coordinates.index("x")
        individuals = header.get("individuals", [""] * len(coordinates))
        columns = list(zip(individuals, header["bodyparts"], coordinates, strict=True))[first:]
        values = np.array([[float(cell or "nan") for cell in row[first:]] for row in body]).reshape(-1, len(columns))
        parts = tuple(dict.fromkeys(part for _, part, _ in columns))
        people = []
        for individual in dict.fromkeys(name for name, _, _ in columns):
            points = np.full((len(body), len(parts), 3), np.nan)
            points[..., 2] = 1.0 if "likelihood" not in coordinates else np.nan
            for k, (name, part, coordinate) in enumerate(columns):
                if name == individual:
                    points[:, parts.index(part), COORDINATES[coordinate]] = values[:, k]
            people.append([keypoints_of(each) for each in points])
    except _INVALID as error:
        raise InputError(f"{file}: expected DeepLabCut's CSV file with bodyparts and coords, found {error!r}") from None
    names = [Path("_".join(row[:first])).stem for row in body]  # a number, or an image's folders and name
    return ordered_points(file, names, [list(frame) for frame in zip(*people, strict=True)], parts)
