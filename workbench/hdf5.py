"""Opening other people's HDF5 files: all that is read lies in the file itself, and is bounded before it is read."""

import sys
from collections.abc import Iterator
from contextlib import contextmanager
from functools import cache
from pathlib import Path

import h5py
import numpy as np

from workbench.apart import bounded, read_apart
from workbench.errors import InputError
from workbench.limits import DEEPEST, MOST_NUMBERS, bounded_memory, check_file, check_number

MOST_BYTES = 1 << 40
"""Of a file; only what is asked for is read."""

MOST_MEMORY = 900_000_000
"""Bytes that reading a file may take: the library believes the lengths of texts, which nothing else bounds."""

MOST_OBJECTS = 1_000_000
MOST_PACKED = 100
"""Bytes that a stored byte may stand for, in a file beyond SMALL_BYTES."""

SMALL_BYTES = 100_000_000

DAMAGES = (
    OSError, ValueError, LookupError, EOFError, AttributeError, TypeError, RuntimeError, MemoryError, OverflowError,
    RecursionError,
)  # fmt: skip
"""Errors that h5py raises for damaged files."""


@contextmanager
def opened(path: Path, what: str, own: bool = False) -> Iterator[h5py.File]:
    """Open an HDF5 file to read `what` it should hold. own: it was written here, and is not read apart first.

    Raises InputError for a file that is damaged, where h5py says so while it is read, and for one that leads outside
    itself (external links, external storage, virtual datasets) or stands for more than the bounds here.
    """
    check_file(path, MOST_BYTES)
    if not own:
        _read_apart(path.resolve(), path.stat().st_mtime_ns, what)
    try:
        with bounded_memory(MOST_MEMORY), h5py.File(path, "r") as file:
            _check(path, file)
            yield file
    except InputError:
        raise
    except DAMAGES as error:
        said = " ".join(str(error).split()) or type(error).__name__
        raise InputError(f"{path}: expected {what} (HDF5): {said}") from None


@cache
def _read_apart(path: Path, _changed_ns: int, what: str) -> None:
    """Read a file once in another process, which may not come back from it."""
    read_apart(__name__, path, f"{what} (HDF5)")


def _touch(path: Path) -> bytes:
    """Read everything that lies in a file."""
    with h5py.File(path, "r") as file:
        _check(path, file)
        pending, seen = [file], set()
        while pending:
            if (address := _address(found := pending.pop())) in seen:
                continue
            seen.add(address)
            _ = dict(found.attrs)
            if isinstance(found, h5py.Dataset):
                _ = found[()]
            else:
                pending += [found[name] for name in found]
    return b""


def _check(path: Path, file: h5py.File) -> None:
    """Walk all groups once, whatever links lead to them, and look at every data set without reading it."""
    seen, total, pending = {_address(file)}, 0, [(file, 0)]
    while pending:
        group, depth = pending.pop()
        for name in group:
            place = f"{path}: {group.name.rstrip('/')}/{name}"
            if not isinstance(group.get(name, getlink=True), h5py.HardLink):
                raise InputError(f"{place}: expected what it names in the file itself, found a link to elsewhere")
            found = group[name]
            if (address := _address(found)) in seen:
                continue
            seen.add(address)
            check_number(path, "groups and data sets", len(seen), MOST_OBJECTS)
            if isinstance(found, h5py.Group):
                check_number(place, "groups in one another", depth + 1, DEEPEST)
                pending.append((found, depth + 1))
            elif isinstance(found, h5py.Dataset):
                total += _bytes_of(place, found)
    most = max(SMALL_BYTES, MOST_PACKED * path.stat().st_size)
    check_number(path, "bytes of numbers in a file of this size", total, most)


def _address(found: h5py.Group | h5py.Dataset) -> int:
    return int(h5py.h5o.get_info(found.id).addr)


def _bytes_of(place: str, found: h5py.Dataset) -> int:
    """What a data set would take in memory."""
    if found.external:
        raise InputError(f"{place}: expected numbers in the file itself, found those of {found.external[0][0]!r}")
    if found.is_virtual:
        raise InputError(f"{place}: expected numbers in the file itself, found a virtual data set")
    count = int(np.prod(found.shape or (), dtype=object))
    check_number(place, "numbers", count, MOST_NUMBERS)
    if count and not found.id.get_storage_size():
        raise InputError(f"{place}: expected {count} numbers, found a data set without any stored")
    return count * found.dtype.itemsize


if __name__ == "__main__":
    bounded(sys.argv[1], _touch)
