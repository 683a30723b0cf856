"""Reading HDF5 files: all that is read lies in the file itself, and is bounded before it is read.

A stranger's file is opened by another process alone, see `apart`, as a damaged one may harm the memory of whoever reads
it. That one tells what is in the file, as JSON, and then what every data set holds that is asked for.
"""

import json
import sys
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple

import h5py
import numpy as np

from workbench.apart import answer, asked_apart, bounded
from workbench.arrays import AnyArray
from workbench.errors import InputError
from workbench.limits import DEEPEST, MOST_NUMBERS, bounded_memory, check_file, check_number, parse_json

MOST_BYTES = 1 << 40
"""Of a file; only what is asked for is read."""

MOST_MEMORY = 900_000_000
"""Bytes that reading a file may take: the library believes the lengths of texts, which nothing else bounds."""

MOST_OBJECTS = 1_000_000
"""Groups and data sets, by each of their names."""

MOST_TEXT = 100_000_000
"""Bytes of a data set that is a text, and of all names and attributes."""

MOST_PACKED = 100
"""Bytes that a stored byte may stand for, in a file beyond SMALL_BYTES."""

SMALL_BYTES = 100_000_000

DAMAGES = (
    OSError, ValueError, LookupError, EOFError, AttributeError, TypeError, RuntimeError, MemoryError, OverflowError,
    RecursionError,
)  # fmt: skip
"""Errors that h5py raises for damaged files."""

_TEXT, _OTHER = "a text", "other values"


class DataSet(NamedTuple):
    """A data set of a file. kind: the dtype of its numbers, or words for what else it holds."""

    place: str
    kind: str
    shape: tuple[int, ...]
    content: Callable[[], bytes | bytearray | memoryview]

    def numbers(self) -> AnyArray:
        """Read the array; raises InputError where it is not one of numbers."""
        if self.kind in (_TEXT, _OTHER):
            raise InputError(f"{self.place}: expected numbers, found {self.kind}")
        return np.frombuffer(self.content(), np.dtype(self.kind)).reshape(self.shape)

    def text(self) -> str:
        """Read the text; raises InputError where it is none."""
        if self.kind != _TEXT:
            raise InputError(f"{self.place}: expected a text, found {self.kind}")
        return bytes(self.content()).decode()


class Group(dict[str, "Group | DataSet"]):
    """A group of a file: what is in it by name, and its attributes, texts and numbers as h5py gives them, else None."""

    attributes: Mapping[str, Any]


class _Node(NamedTuple):
    """A group or a data set, as one process tells another of it. inside: the numbers of the nodes in a group by name;
    None for a data set. attributes: see `_packed`."""

    name: str
    inside: Mapping[str, int] | None
    attributes: Mapping[str, Any]
    kind: str = ""
    shape: Sequence[int] = ()


@contextmanager
def opened(path: Path, what: str, own: bool = False) -> Iterator[Group]:
    """Open an HDF5 file to read `what` it should hold. own: it was written here, and this process reads it itself.

    Raises InputError for a file that is damaged, where h5py says so while it is read, and for one that leads outside
    itself (external links, external storage, virtual datasets) or stands for more than the bounds here.
    """
    check_file(path, MOST_BYTES)
    try:
        with (_read_here if own else _read_apart)(path, f"{what} (HDF5)") as found:
            yield found
    except InputError:
        raise
    except DAMAGES as error:
        said = " ".join(str(error).split()) or type(error).__name__
        raise InputError(f"{path}: expected {what} (HDF5): {said}") from None


@contextmanager
def _read_here(path: Path, _what: str) -> Iterator[Group]:
    with bounded_memory(MOST_MEMORY), h5py.File(path, "r") as file:
        nodes = _nodes(path, file)
        yield _tree(path, nodes, lambda number, _: _content(file, nodes[number]))


@contextmanager
def _read_apart(path: Path, what: str) -> Iterator[Group]:
    with asked_apart(__name__, path, what) as ask:
        nodes = [_Node(*node) for node in parse_json(path, ask("", MOST_TEXT))]
        yield _tree(path, nodes, lambda number, most: ask(str(number), most))


def _tell(path: Path) -> bytes:
    """Tell, in the other process, what is in a file, and then the content of each data set whose number is asked."""
    with h5py.File(path, "r") as file:
        nodes = _nodes(path, file)
        answer(lambda asked: _content(file, nodes[int(asked)]) if asked else json.dumps(nodes).encode())
    return b""


def _tree(path: Path, nodes: Sequence[_Node], content: Callable[[int, int], bytes | bytearray | memoryview]) -> Group:
    """The root of a file, where `content` reads the data set of a number, of at most so many bytes."""
    found: list[Group | DataSet] = []
    for number, node in enumerate(nodes):
        if node.inside is not None:
            found.append(Group())
        else:
            most = MOST_TEXT if node.kind in (_TEXT, _OTHER) else _count(node.shape) * np.dtype(node.kind).itemsize
            read = partial(content, number, most)
            found.append(DataSet(f"{path}: {node.name}", node.kind, tuple(node.shape), read))
    for node, group in zip(nodes, found, strict=True):
        if isinstance(group, Group):
            group.attributes = {name: _unpacked(value) for name, value in node.attributes.items()}
            group.update({name: found[number] for name, number in (node.inside or {}).items()})
    root = found[0]
    assert isinstance(root, Group)
    return root


def _nodes(path: Path, file: h5py.File) -> list[_Node]:
    """Walk all groups once, whatever links lead to them, and look at every data set without reading it."""
    nodes, numbers, pending = [_Node("/", {}, {})], {_address(file): 0}, [(file, 0)]
    total = n_names = 0
    while pending:
        group, depth = pending.pop()
        here, inside = numbers[_address(group)], {}
        for name in group:
            whole = f"{group.name.rstrip('/')}/{name}"
            place = f"{path}: {whole}"
            check_number(path, "groups and data sets", n_names := n_names + 1, MOST_OBJECTS)
            if not isinstance(group.get(name, getlink=True), h5py.HardLink):
                raise InputError(
                    f"{path}: {whole}: expected what it names in the file itself, found a link to elsewhere"
                )
            found = group[name]
            inside[name] = numbers.setdefault(_address(found), len(nodes))
            if inside[name] < len(nodes):
                continue
            if isinstance(found, h5py.Group):
                check_number(place, "groups in one another", depth + 1, DEEPEST)
                nodes.append(_Node(whole, {}, {}))
                pending.append((found, depth + 1))
            else:
                nodes.append(_Node(whole, None, {}, _OTHER))
                if isinstance(found, h5py.Dataset):
                    total += _bytes_of(place, found)
                    nodes[-1] = nodes[-1]._replace(kind=_kind(found), shape=found.shape or ())
        attributes = {name: _packed(value) for name, value in group.attrs.items()}
        nodes[here] = nodes[here]._replace(inside=inside, attributes=attributes)
    most = max(SMALL_BYTES, MOST_PACKED * path.stat().st_size)
    check_number(path, "bytes of numbers in a file of this size", total, most)
    return nodes


def _address(found: h5py.Group | h5py.Dataset) -> int:
    return int(h5py.h5o.get_info(found.id).addr)


def _bytes_of(place: str, found: h5py.Dataset) -> int:
    """What a data set would take in memory."""
    if found.external:
        raise InputError(f"{place}: expected numbers in the file itself, found those of {found.external[0][0]!r}")
    if found.is_virtual:
        raise InputError(f"{place}: expected numbers in the file itself, found a virtual data set")
    count = _count(found.shape or ())
    check_number(place, "numbers", count, MOST_NUMBERS)
    if count and not found.id.get_storage_size():
        raise InputError(f"{place}: expected {count} numbers, found a data set without any stored")
    return count * found.dtype.itemsize


def _count(shape: Sequence[int]) -> int:
    return int(np.prod(shape, dtype=object))


def _kind(found: h5py.Dataset) -> str:
    if found.dtype.kind in "biuf" and found.shape is not None:
        return str(found.dtype)
    return _TEXT if h5py.check_string_dtype(found.dtype) and found.shape == () else _OTHER


def _content(file: h5py.File, node: _Node) -> bytes | memoryview:
    """The bytes of a data set's numbers, or of its text."""
    found = file[node.name]
    if node.kind == _TEXT:
        return str(found.asstr()[()]).encode()
    return np.ascontiguousarray(found[()]).reshape(-1).view(np.uint8).data


def _packed(value: Any) -> Any:
    """An attribute for JSON: a text as it is, numbers with their dtype, None for anything else."""
    if isinstance(value, str):
        return value
    if isinstance(value, np.generic | np.ndarray) and value.dtype.kind in "biuf" and value.dtype.itemsize <= 8:
        return [str(value.dtype), value.tolist()]
    return None


def _unpacked(value: Any) -> Any:
    return np.array(value[1], value[0])[()] if isinstance(value, list) else value


if __name__ == "__main__":
    bounded(sys.argv[1], _tell)
