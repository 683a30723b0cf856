"""Strict readers of point clouds: PLY (Turk 1994; ascii and binary), NPZ, CSV and HDF5.

PLY has its own parser here, because the common package is under the GPL and this project under the MIT licence.
"""

import csv
import re
import struct
import tokenize
import warnings
import zipfile
import zlib
from collections.abc import Iterator, Sequence
from pathlib import Path

import numpy as np

from workbench.datasets.files import natural_order
from workbench.motion.formats.text import fail
from workbench.utils import hdf5
from workbench.utils.arrays import AnyArray, FloatArray
from workbench.utils.errors import InputError
from workbench.utils.input_limits import MAX_NUMBERS, check_file, check_number

AXES = ("x", "y", "z")
_PLY_TYPES = {
    "char": "i1", "int8": "i1", "uchar": "u1", "uint8": "u1", "short": "i2", "int16": "i2", "ushort": "u2",
    "uint16": "u2", "int": "i4", "int32": "i4", "uint": "u4", "uint32": "u4", "float": "f4", "float32": "f4",
    "double": "f8", "float64": "f8",
}  # fmt: skip
_PLY_FORMATS = {"ascii": "", "binary_little_endian": "<", "binary_big_endian": ">"}
_HEADER_BYTES = 1 << 16
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
    """Read the points (K, 3) of a CSV file with a header that includes x, y and z; raises InputError with the line."""
    lines = _stripped(_text(path, _bytes(path)).removeprefix("\ufeff").split("\n"))
    columns = [cell.strip() for cell in lines[0].split(",")] if lines else []
    if len(set(columns)) < len(columns) or not set(AXES) <= set(columns):
        raise InputError(f"{path}, line 1: expected the columns x, y and z, found {', '.join(columns)[:60]!r}")
    return _rows(path, lines[1:], 2, columns, ",", len(lines) - 1, False)


def read_npz(path: Path) -> FloatArray:
    """Read the array `points` (K, 3) of an NPZ file, or its only array; raises InputError for other contents."""
    _bytes(path, 1)
    try:
        with zipfile.ZipFile(path) as packed:
            check_number(path, "bytes of arrays", sum(each.file_size for each in packed.infolist()), 8 * MAX_NUMBERS)
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", UserWarning)  # of old headers
            with np.load(path, allow_pickle=False) as stored:
                names = list(stored.files)
                name = names[0] if len(names) == 1 else "points"
                values = stored[name] if name in names else None
    except InputError:
        raise
    except _DAMAGE_ERRORS as error:
        raise InputError(f"{path}: expected a complete NPZ file of numbers: {_message(error)}") from None
    if values is None:
        raise InputError(f"{path}: expected one array, or one called 'points', found {', '.join(names) or 'none'}")
    return _table(f"{path}: {name}", values)


def read_hdf5(path: Path) -> Iterator[FloatArray]:
    """Yield the points of every frame of an HDF5 file, the datasets (K, 3) of its group /frames in natural order;
    raises InputError for other contents."""
    file = hdf5.read_hdf5(path, "a complete file of points")
    places = [place for place in (*file.attributes, *file.arrays) if place.startswith("/frames/")]
    if not places:
        raise InputError(f"{path}: expected frames of points in the group /frames, found none")
    for place in natural_order(places):
        if place not in file.arrays:
            raise InputError(f"{path}: {place}: expected an array (K, 3), found a group")
        yield _table(f"{path}: {place}", file.arrays[place])


READERS = {".ply": read_ply, ".npz": read_npz, ".csv": read_csv}  # by file extension: one frame per file


def checked(place: object, points: FloatArray, row: str = "row") -> FloatArray:
    """Return points (K, 3); raises InputError for none, and the first (rows from 1) that is not finite or too large."""
    if not len(points):
        raise InputError(f"{place}: expected points, found none")
    bad = ~(np.abs(points) < _MAX_COORDINATE).all(axis=1)
    if bad.any():
        k = int(np.argmax(bad))
        raise InputError(f"{place}, {row} {k + 1}: expected finite x, y, z, found {points[k].tolist()}")
    return points


def _ply_header(path: Path, content: bytes) -> tuple[int, dict[str, str], str, int, bool]:
    """Return number of vertices, types of their properties, byte order, end of the header, and whether more follows."""
    end = re.search(rb"(?:^|\n)end_header[ \t]*\r?\n", content[:_HEADER_BYTES])
    if not re.match(rb"ply[ \t]*\r?\n", content) or end is None:
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
            case ["property", kind, name] if elements == 1 and kind in _PLY_TYPES and name not in columns:
                columns[name] = _PLY_TYPES[kind]
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
        raise InputError(f"{path}: expected points, found none")
    try:
        values = np.loadtxt(rows, dtype=np.float64, delimiter=delimiter, comments=None, ndmin=2)
    except (ValueError, csv.Error):
        values = np.empty((0, 0))
    at = [columns.index(axis) for axis in AXES]
    if values.shape == (n, len(columns)) and (np.abs(values[:, at]) < _MAX_COORDINATE).all():
        return values[:, at]
    for number, line in enumerate(rows, first):
        cells = line.split(delimiter)
        if len(cells) != len(columns):
            fail(path, number, f"expected {len(columns)} numbers ({', '.join(columns)}), found {line[:60]!r}")
        for name, cell in zip(columns, cells, strict=True):
            if not _is_number(cell, finite=name in AXES):
                fail(path, number, f"expected a finite number for {name}, found {cell[:60]!r}")
    raise InputError(f"{path}: expected {n} rows of {len(columns)} numbers from line {first} on")


def _is_number(cell: str, finite: bool) -> bool:
    try:
        value = float(cell)
    except ValueError:
        return False
    return "_" not in cell and (abs(value) < _MAX_COORDINATE or not finite)


def _table(place: str, values: AnyArray) -> FloatArray:
    """Return an array (K, 3) of finite real numbers as float64; raises InputError for another one."""
    values = np.asarray(values)
    if values.ndim != 2 or values.shape[1] != 3 or values.dtype.kind not in "fiu":
        raise InputError(f"{place}: expected points (K, 3) of numbers, found {values.shape} {values.dtype}")
    return checked(place, values.astype(np.float64))


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
    while lines and not lines[-1].strip():
        lines = lines[:-1]
    return lines


def _message(error: BaseException) -> str:
    return " ".join(str(error).split())[:200] or type(error).__name__
