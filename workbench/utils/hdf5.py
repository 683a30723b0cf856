"""Read HDF5 files, those of users in the sandbox: damage can crash the library or keep it in a loop."""

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any, NamedTuple

import h5py
import numpy as np

from workbench.utils.arrays import AnyArray
from workbench.utils.errors import InputError
from workbench.utils.input_limits import DEEPEST, MAX_NUMBERS, check_file, check_number
from workbench.utils.sandbox import parse_limited

MOST_BYTES = 1 << 40  # of a file
_MOST_OBJECTS = 1_000_000  # groups and data sets of a file
_MOST_PACKED = 100  # bytes of numbers for each stored byte, in files with more than _SMALL_BYTES of them
_SMALL_BYTES = 100_000_000
OTHER = "values that are neither numbers nor a text"
_ATTRIBUTES = "attributes"


class Hdf5(NamedTuple):
    """Content of a file. arrays: data sets of numbers and texts by path, such as /motions/0/poses. attributes: texts
    and numbers by path of the group, then by name."""

    arrays: Mapping[str, AnyArray]
    attributes: Mapping[str, Mapping[str, Any]]


def read_hdf5(path: Path, what: str, own: bool = False) -> Hdf5:
    """Return all numbers, texts and attributes of a file; OTHER in place of other data sets.

    what: the expected content, for the message. own: written by the workbench itself, such as a file in its cache, and
    read without the sandbox. Raises InputError for damage, links, data sets that lie in other files, and more numbers
    than the bounds.
    """
    check_file(path, MOST_BYTES)
    try:
        arrays = dict(contents(path)) if own else parse_limited(contents, path, what=f"{what} (HDF5)")
        return Hdf5(arrays, json.loads(str(arrays.pop(_ATTRIBUTES))))
    except InputError:
        raise
    except (OSError, ValueError, LookupError, RuntimeError, TypeError) as error:
        raise InputError(f"{path}: expected {what} (HDF5): {' '.join(str(error).split())}") from None


def contents(path: Path) -> dict[str, AnyArray]:
    """Return the data sets of a file by path and, as "attributes", those of all groups in JSON."""
    arrays: dict[str, AnyArray] = {}
    attributes: dict[str, dict[str, Any]] = {}
    pending, n_objects, n_bytes = ["/"], 0, 0
    with h5py.File(path, "r") as file:
        while pending:
            group = file[pending.pop()]
            attributes[group.name] = dict(group.attrs)
            for name in group:
                place = f"{group.name.rstrip('/')}/{name}"
                check_number(path, "groups and data sets", n_objects := n_objects + 1, _MOST_OBJECTS)
                if not isinstance(group.get(name, getlink=True), h5py.HardLink):
                    raise InputError(f"{path}: {place}: expected data in the file itself, found a link")
                if isinstance(each := group[name], h5py.Group):
                    check_number(path, "groups in one another", place.count("/"), DEEPEST)
                    pending.append(place)
                elif isinstance(each, h5py.Dataset):
                    n_bytes += _size(f"{path}: {place}", each)
                    most = max(_SMALL_BYTES, _MOST_PACKED * path.stat().st_size)
                    check_number(path, "bytes of numbers in a file of this size", n_bytes, most)
                    numbers = each.dtype.kind in "biuf" and each.shape is not None
                    text = h5py.check_string_dtype(each.dtype) and each.shape == ()
                    arrays[place] = np.asarray(each[()] if numbers else each.asstr()[()] if text else OTHER)
    packed = json.dumps(attributes, default=lambda value: getattr(value, "tolist", lambda: None)())  # None: neither
    return arrays | {_ATTRIBUTES: np.array(packed)}


def _size(place: str, found: h5py.Dataset) -> int:
    """Return the bytes of a data set in memory; raises InputError for one that is not stored in the file."""
    if found.external or found.is_virtual:
        raise InputError(f"{place}: expected numbers in the file itself, found those of another")
    check_number(place, "numbers", size := int(found.size or 0), MAX_NUMBERS)
    if size and not found.id.get_storage_size():
        raise InputError(f"{place}: expected {size} numbers, found none stored")
    return size * int(found.dtype.itemsize)
