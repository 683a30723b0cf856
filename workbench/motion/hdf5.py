"""Read HDF5 files; untrusted ones in the sandbox, as damage can crash the library or cause an endless loop."""

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
    """Content of a file.

    arrays: data sets of numbers and texts by path, such as /motions/0/poses. attributes: by path of the group and name.
    """

    arrays: Mapping[str, AnyArray]
    attributes: Mapping[str, Mapping[str, Any]]


def read_hdf5(path: Path, what: str, own: bool = False) -> Hdf5:
    """Return all numbers, texts and attributes of a file; OTHER in place of other data sets.

    Parameters
    ----------
    path : the file.
    what : the expected content, for the message.
    own : whether the workbench wrote the file, such as in its cache; it is then read without the sandbox.

    Raises
    ------
    InputError : damage, links, data sets in other files, or more numbers than the bounds.
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
                    raise InputError(f"{path}: {place}: expected a data set, found a link")
                if isinstance(item := group[name], h5py.Group):
                    check_number(path, "nested groups", place.count("/"), DEEPEST)
                    pending.append(place)
                elif isinstance(item, h5py.Dataset):
                    n_bytes += _size(f"{path}: {place}", item)
                    limit = max(_SMALL_BYTES, _MOST_PACKED * path.stat().st_size)
                    check_number(path, "bytes of numbers in a file of this size", n_bytes, limit)
                    numbers = item.dtype.kind in "biuf" and item.shape is not None
                    text = h5py.check_string_dtype(item.dtype) and item.shape == ()
                    arrays[place] = np.asarray(item[()] if numbers else item.asstr()[()] if text else OTHER)
    # None: neither a number nor a text
    packed = json.dumps(attributes, default=lambda value: getattr(value, "tolist", lambda: None)())
    return arrays | {_ATTRIBUTES: np.array(packed)}


def _size(place: str, dataset: h5py.Dataset) -> int:
    """Return the bytes of a data set in memory; InputError if it is not stored in the file."""
    if dataset.external or dataset.is_virtual:
        raise InputError(f"{place}: expected numbers in this file, found a reference to another file")
    check_number(place, "numbers", size := int(dataset.size or 0), MAX_NUMBERS)
    if size and not dataset.id.get_storage_size():
        raise InputError(f"{place}: expected {size} numbers, found none stored")
    return size * int(dataset.dtype.itemsize)
