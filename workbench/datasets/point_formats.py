"""Readers of point clouds: PLY (Turk 1994; ascii and binary), PCD, NPY, NPZ, CSV, XYZ and HDF5.

A point with a coordinate that is not a number is omitted, and a frame may be without points.

PLY has its own parser here, because the common package is under the GPL and this project under the MIT licence.
"""

import csv
import math
import re
import struct
import tokenize
import warnings
import zipfile
import zlib
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path

import numpy as np

from workbench.motion import hdf5
from workbench.motion.formats.text import MISSING, fail, read_lines
from workbench.utils.arrays import AnyArray, FloatArray
from workbench.utils.errors import InputError
from workbench.utils.input_limits import MAX_NUMBERS, check_file, check_number
from workbench.utils.text import natural_order

AXES = ("x", "y", "z")
_PLY_TYPES = {
    "char": "i1", "int8": "i1", "uchar": "u1", "uint8": "u1", "short": "i2", "int16": "i2", "ushort": "u2",
    "uint16": "u2", "int": "i4", "int32": "i4", "uint": "u4", "uint32": "u4", "float": "f4", "float32": "f4",
    "double": "f8", "float64": "f8",
}  # fmt: skip
_PLY_FORMATS = {"ascii": "", "binary_little_endian": "<", "binary_big_endian": ">"}
_COLUMN = re.compile(
    r"(?:p|pos|position|points?)?[_:. ]*([xyz])(?:[_ ]*[(\[]?(?:m|cm|mm|inch)[)\]]?)?|points?[_:. ]*([012])", re.I
)
_COMMENT = re.compile(r"\s*(?:#|//)\s*")
_HEADER_BYTES = 1 << 16
_MAX_TEXT = 40_000_000
"""Bytes of a text file, which takes 50 times as much memory: 0.7 million points with seven digits a coordinate."""
_MAX_COORDINATE = 1e12  # larger ones are errors in any unit
_DAMAGE_ERRORS = (
    OSError, ValueError, LookupError, EOFError, AttributeError, TypeError, RuntimeError, MemoryError, OverflowError,
    zipfile.BadZipFile, zlib.error, struct.error, tokenize.TokenError, SyntaxError,
)  # fmt: skip
"""Errors that NumPy raises for damaged files."""


def read_ply(path: Path) -> FloatArray:
    """Read the points (K, 3) of a PLY file's vertices, ignoring other properties; raises InputError unless the file is
    complete and its first element is `vertex` with scalar x, y and z."""
    content = _bytes(path)
    n, columns, order, begin, has_more = _ply_header(path, content)
    missing = [axis for axis in AXES if axis not in columns]
    if missing:
        raise InputError(f"{path}: expected vertices with x, y and z, found {', '.join(columns) or 'no property'}")
    if order == "":
        _check_text(path)
        first_line = content[:begin].count(b"\n") + 1
        lines = _text(path, content[begin:]).split("\n")
        return _rows(path, lines if has_more else _stripped(lines), first_line, list(columns), None, n, has_more)
    kind = np.dtype([(name, order + code) for name, code in columns.items()])
    n_bytes = len(content) - begin
    if n_bytes < n * kind.itemsize or (n_bytes > n * kind.itemsize and not has_more):
        expected = f"{n} vertices of {kind.itemsize} bytes, {n * kind.itemsize}"
        raise InputError(f"{path}: expected {expected}, found {n_bytes}")
    vertices = np.frombuffer(content, kind, n, begin)
    return checked(path, np.stack([vertices[axis].astype(np.float64) for axis in AXES], axis=1), "vertex")


def read_csv(path: Path) -> FloatArray:
    """Read the points (K, 3) of a CSV or XYZ file, separated by commas, semicolons, tabs or blanks.

    The header includes x, y and z, in any case, perhaps with a unit; without a header the first three columns are read.
    The number of points and comments (# or //) may precede them. An empty file is a frame without points. Raises
    InputError, with the line, for other content.
    """
    _check_text(path)
    lines = _stripped(read_lines(path))
    first = _preamble(lines) + 1
    lines = lines[first - 1 :]
    if not lines:
        return np.empty((0, 3))
    header = _COMMENT.sub("", lines[0], count=1)
    delimiter = next((mark for mark in "\t;," if mark in header), None)
    cells = [cell.strip().strip('"') for cell in header.split(delimiter)]
    if delimiter != ",":
        lines = [line.replace(",", ".") for line in lines]
    if len(cells) >= 3 and all(_is_number(cell.replace(",", "."), finite=False) for cell in cells):
        columns = [*AXES, *[f"column {k}" for k in range(4, len(cells) + 1)]]
        return _rows(path, lines, first, columns, delimiter, len(lines), False)
    columns = [_axis(cell) or cell for cell in cells]
    if len(set(columns)) < len(columns) or not set(AXES) <= set(columns):
        raise InputError(f"{path}, line {first}: expected the columns x, y and z, found {', '.join(cells)[:60]!r}")
    return _rows(path, lines[1:], first + 1, columns, delimiter, len(lines) - 1, False)


def _preamble(lines: Sequence[str]) -> int:
    """Return the number of lines before a table: its number of points, perhaps with a line of text, and comments."""
    count = lines[0].strip() if lines else ""
    n = len(lines) - int(count) if re.fullmatch("[0-9]{1,9}", count) else 0
    n = n if n in (1, 2) else 0
    while n < len(lines) and (comment := _COMMENT.match(lines[n])):
        if {*map(_axis, re.split(r"[\s,;]+", lines[n][comment.end() :]))} >= set(AXES):
            break  # the names of the columns
        n += 1
    return n


def _axis(name: str) -> str:
    """Return the axis of a column's name, "" for another column."""
    match = _COLUMN.fullmatch(name.strip().strip('"'))
    return "" if match is None else AXES[int(match[2])] if match[2] else match[1].lower()


def read_pcd(path: Path) -> FloatArray:
    """Read the points (K, 3) of a PCD file of the Point Cloud Library, ascii or binary; raises InputError unless the
    file is complete and has fields x, y and z."""
    content = _bytes(path)
    end = re.search(rb"(?:^|\n)DATA[ \t]+(ascii|binary)[ \t]*\r?\n", content[:_HEADER_BYTES])
    if end is None:
        raise InputError(
            f"{path}: expected a PCD file with DATA ascii or binary, found none; convert other ones to PLY"
        )
    header = {words[0]: words[1:] for line in _text(path, content[: end.end()]).split("\n") if (words := line.split())}
    names = [name.lower() for name in header.get("FIELDS", [])]
    size = [*header.get("WIDTH", [""]), *header.get("HEIGHT", [""])]
    if not all(re.fullmatch("[0-9]{1,9}", word) for word in size):
        raise InputError(f"{path}: expected whole numbers WIDTH and HEIGHT of points, found {' '.join(size)[:60]!r}")
    n = math.prod(map(int, size))
    kinds, sizes, counts = header.get("TYPE", []), header.get("SIZE", []), header.get("COUNT", ["1"] * len(names))
    if not set(AXES) <= set(names) or not len(names) == len(kinds) == len(sizes) == len(set(names)):
        raise InputError(f"{path}: expected the fields x, y and z with their types and sizes, found {', '.join(names)}")
    check_number(path, "points", n, MAX_NUMBERS)
    if end[1] == b"ascii":
        _check_text(path)
        lines = _stripped(_text(path, content[end.end() :]).split("\n"))
        return _rows(path, lines, content[: end.end()].count(b"\n") + 1, names, None, n, False)
    try:
        codes = [f"({int(c)},)<{k.lower()}{int(s)}" for k, s, c in zip(kinds, sizes, counts, strict=True)]
        kind = np.dtype([(name, code) for name, code in zip(names, codes, strict=True)])
        values = np.frombuffer(content, kind, n, end.end())
    except (ValueError, TypeError) as error:
        raise InputError(f"{path}: expected a complete PCD file: {_message(error)}") from None
    return checked(path, np.stack([values[axis][:, 0].astype(np.float64) for axis in AXES], axis=1), "point")


def read_npy(path: Path) -> FloatArray:
    """Read the points of an NPY file, an array (K, 3 or more) or one with fields x, y, z; raises InputError for other
    contents."""
    return _table(str(path), read_array(path))


def read_array(path: Path) -> AnyArray:
    """Return the array of an NPY file; InputError for a damaged file, one with objects, and one above MAX_NUMBERS."""
    _bytes(path, 1)
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", UserWarning)  # of old headers
            values: AnyArray = np.load(path, mmap_mode="r", allow_pickle=False)
    except _DAMAGE_ERRORS as error:
        raise InputError(f"{path}: expected a complete NPY file of numbers: {_message(error)}") from None
    check_number(path, "numbers", int(np.size(values)), MAX_NUMBERS)
    return values


def read_npz(path: Path) -> FloatArray:
    """Read the array `points` or `xyz` (K, 3), in any case, of an NPZ file, or its only array.

    Raises InputError for other contents.
    """

    def chosen(names: Sequence[str]) -> list[str]:
        name = next((each for each in names if len(names) == 1 or each.lower() in ("points", "xyz")), None)
        if name is None:
            listed = ", ".join(names) or "none"
            raise InputError(f"{path}: expected one array, or one called 'points', found {listed}")
        return [name]

    ((name, values),) = read_arrays(path, chosen).items()
    return _table(f"{path}: {name}", values)


def read_arrays(path: Path, chosen: Callable[[Sequence[str]], Sequence[str]]) -> dict[str, AnyArray]:
    """Return arrays of numbers and texts of an NPZ file by name, those that `chosen` returns of all names.

    Raises InputError for a damaged file, one with other objects, and one above MAX_NUMBERS.
    """
    _bytes(path, 1)
    try:
        with zipfile.ZipFile(path) as packed:
            check_number(path, "bytes of arrays", sum(each.file_size for each in packed.infolist()), 8 * MAX_NUMBERS)
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", UserWarning)  # of old headers
            with np.load(path, allow_pickle=False) as stored:
                return {name: stored[name] for name in chosen(stored.files)}
    except InputError:
        raise
    except _DAMAGE_ERRORS as error:
        raise InputError(f"{path}: expected a complete NPZ file of numbers: {_message(error)}") from None


def read_hdf5(path: Path) -> Iterator[FloatArray]:
    """Yield the points of every frame of an HDF5 file, the datasets (K, 3) of its group /frames in natural order;
    raises InputError for other contents."""
    file = hdf5.read_hdf5(path, "a complete file of points")
    places = [place for place in (*file.attributes, *file.arrays) if place.startswith("/frames/")]
    if not places:
        raise InputError(f"{path}: expected frames of points in the group /frames, found none")
    for place, _ in natural_order(places):
        if place not in file.arrays:
            raise InputError(f"{path}: {place}: expected an array (K, 3), found a group")
        yield _table(f"{path}: {place}", file.arrays[place])


READERS = {
    ".ply": read_ply, ".pcd": read_pcd, ".npy": read_npy, ".npz": read_npz, ".csv": read_csv, ".xyz": read_csv,
}  # fmt: skip  # by file extension: one frame per file


def checked(place: object, points: FloatArray, row: str = "row") -> FloatArray:
    """Return the points (K, 3) without NaN; raises InputError for the first (rows from 1) that is too large."""
    bad = (np.abs(points) >= _MAX_COORDINATE).any(axis=1)
    if bad.any():
        k = int(np.argmax(bad))
        raise InputError(f"{place}, {row} {k + 1}: expected finite x, y, z, found {points[k].tolist()}")
    measured = np.isfinite(points).all(axis=1)
    return points if measured.all() else points[measured]


def _ply_header(path: Path, content: bytes) -> tuple[int, dict[str, str], str, int, bool]:
    """Return number of vertices, types of their properties, byte order, end of the header, and whether more follows."""
    end = re.search(rb"(?:^|\n)end_header[ \t]*\r?\n", content[:_HEADER_BYTES])
    if not re.match(rb"(?i:ply)[ \t]*\r?\n", content) or end is None:
        raise InputError(f"{path}: expected a PLY file with a header from 'ply' to 'end_header', found none")
    n, columns, order, elements = None, {}, None, 0
    for number, line in enumerate(_text(path, content[: end.end()]).split("\n")[1:], 2):
        match line.split():
            case [] | ["comment" | "obj_info" | "end_header", *_]:
                pass
            case ["format", name, "1.0"] if name in _PLY_FORMATS and order is None:
                order = _PLY_FORMATS[name]
            case ["element", "vertex", count] if elements == 0 and count.isascii() and count.isdigit():
                n, elements = int(count[:18]), 1
            case ["element", _, count] if elements and count.isascii() and count.isdigit():
                elements += 1
            case ["property", kind, name] if elements == 1 and kind in _PLY_TYPES and name.lower() not in columns:
                columns[name.lower()] = _PLY_TYPES[kind]
            case ["property", *_] if elements > 1:
                pass
            case _:
                fail(path, number, f"expected a PLY header that begins with vertices of scalars, found {line[:60]!r}")
    if n is None or order is None:
        raise InputError(f"{path}: expected a PLY header with a format and an element vertex, found neither or one")
    return n, columns, order, end.end(), elements > 1


def _rows(
    path: Path, lines: Sequence[str], first: int, columns: Sequence[str], delimiter: str | None, n: int, has_more: bool
) -> FloatArray:
    """Read points (n, 3), one per line, from line number `first` on; has_more: whether other lines may follow."""
    if len(lines) < n or (len(lines) > n and not has_more):
        raise InputError(f"{path}: expected {n} rows of points from line {first} on, found {len(lines)} lines")
    rows = lines[:n]
    if not rows:
        return np.empty((0, 3))
    at = [columns.index(axis) for axis in AXES]
    for attempt in (rows, _without_gaps(rows, delimiter)):
        try:
            values = np.loadtxt(attempt, dtype=np.float64, delimiter=delimiter, comments=None, ndmin=2)
        except (ValueError, csv.Error):
            continue
        if values.shape == (n, len(columns)) and not (np.abs(values[:, at]) >= _MAX_COORDINATE).any():
            return checked(path, values[:, at])
    for number, line in enumerate(rows, first):
        cells = line.split(delimiter)
        if len(cells) != len(columns):
            fail(path, number, f"expected {len(columns)} numbers ({', '.join(columns)}), found {line[:60]!r}")
        for name, cell in zip(columns, cells, strict=True):
            if not _is_number(cell, finite=name in AXES):
                fail(path, number, f"expected a finite number for {name}, found {cell[:60]!r}")
    raise InputError(f"{path}: expected {n} rows of {len(columns)} numbers from line {first} on")


def _without_gaps(rows: Sequence[str], delimiter: str | None) -> Iterator[str]:
    """Yield rows with nan for missing cells."""
    for row in rows:
        cells = [cell.strip() for cell in row.split(delimiter)]
        yield (delimiter or " ").join("nan" if cell.lower() in MISSING else cell for cell in cells)


def _is_number(cell: str, finite: bool) -> bool:
    try:
        value = float(cell)
    except ValueError:
        return False
    return "_" not in cell and (not abs(value) >= _MAX_COORDINATE or not finite)


def _table(place: str, values: AnyArray) -> FloatArray:
    """Return the first three columns of an array of real numbers, or its fields x, y, z, as float64; raises InputError
    for another one."""
    values = np.asarray(values)
    if values.dtype.names and set(AXES) <= set(values.dtype.names):
        values = np.stack([values[axis].ravel() for axis in AXES], axis=1)
    if values.ndim != 2 or values.shape[1] < 3 or values.dtype.kind not in "fiu":
        raise InputError(f"{place}: expected points (K, 3) of numbers, found {values.shape} {values.dtype}")
    return checked(place, values[:, :3].astype(np.float64))


def _check_text(path: Path) -> None:
    """Raise InputError, with a remedy, for a text file of more than _MAX_TEXT bytes."""
    if path.is_file() and (size := path.stat().st_size) > _MAX_TEXT:
        raise InputError(
            f"{path}: expected at most {_MAX_TEXT / 1e6:g} MB of text, found {size / 1e6:.0f} MB; write a binary file, "
            ".ply or .npy, or fewer points"
        )


def _bytes(path: Path, max_bytes: int = -1) -> bytes:
    check_file(path)
    try:
        with path.open("rb") as file:
            return file.read(max_bytes)
    except OSError as error:
        raise InputError(f"{path}: cannot be read: {error.strerror or error}") from None


def _text(path: Path, content: bytes) -> str:
    try:
        return content.decode("utf-8").replace("\r\n", "\n")
    except UnicodeDecodeError as error:
        raise InputError(f"{path}: expected UTF-8 text, found other bytes at {error.start}") from None


def _stripped(lines: list[str]) -> list[str]:
    """Return the lines without trailing blank ones."""
    end = next((k for k in range(len(lines), 0, -1) if lines[k - 1].strip()), 0)
    return lines[:end]


def _message(error: BaseException) -> str:
    return " ".join(str(error).split())[:200] or type(error).__name__
