"""Low-level readers of Rerun files: static values, curves, and values by frame."""

import logging
import os
import shutil
import struct
import warnings
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, BinaryIO, TypeVar

import numpy as np
import pyarrow as pa  # type: ignore[import-untyped]
from rerun.chunk import Chunk, RrdReader
from rerun.error_utils import RerunWarning

from workbench.utils.arrays import FloatArray, IntArray
from workbench.utils.errors import InputError

log = logging.getLogger(__name__)

_CONVERSION_ERRORS = (
    pa.ArrowException, ArithmeticError, AttributeError, LookupError, MemoryError, RuntimeError, TypeError, ValueError,
)  # fmt: skip
"""Errors raised by converting values of unexpected types."""

EVERYTHING = ("/**", "/__properties/**")
"""Contents of a whole recording."""
SCALARS, DRAWS = "Scalars:scalars", "Draws:poses"
"""Components of curves and of samples of the motion."""


@dataclass(frozen=True, eq=False)
class Curve:
    """Numbers over frames. frames: (F,), ascending; values: (F, k)."""

    frames: IntArray
    values: FloatArray


_TORN = ("exceeds file size", "without footer")
_ADVICE = "; `rerun rrd optimize FILE -o WHOLE.rrd` saves what comes before the cut"
_Result = TypeVar("_Result")


@contextmanager
def sound(path: Path) -> Iterator[None]:
    """Raise an InputError that names the recording for errors of converting its values in the block."""
    try:
        yield
    except InputError:
        raise
    except _CONVERSION_ERRORS as error:
        text = " ".join(f"{type(error).__name__}: {error}".split())
        raise InputError(f"{path}: expected values of the types that runs record, found others: {text}") from None


def read_chunks(path: Path, contents: Sequence[str], components: Sequence[str] | None = None) -> list[Chunk]:
    """Return the chunks of the entities `contents`, such as /metrics/**, of an .rrd or an incomplete .part.

    components: those to read, such as Points2D:radii; None: all.

    Of a .part all whole messages are read. Raises InputError when there is no such file, or it is not a recording, or
    it is cut and no .part.
    """

    def read(reader: RrdReader, has_footer: bool) -> list[Chunk]:
        if has_footer and len(runs := reader.recordings()) > 1:
            unread = ", ".join(each.recording_id for each in runs[1:])
            _say_once(f"{path}: holds {len(runs)} merged recordings, of which the first is read; not read: {unread}")
        stream = reader.store().stream() if has_footer else reader.stream()  # by the footer, nothing else is read
        return stream.filter(content=[*contents], components=components).to_chunks()

    return _read_with(read, path)


@lru_cache(maxsize=64)  # a recording is read in several parts
def _say_once(message: str) -> None:
    log.warning("%s", message)


def _read_with(read: Callable[[RrdReader, bool], _Result], path: Path) -> _Result:
    """Return read(reader, whether the file has a footer)."""
    if not path.is_file():
        raise InputError(f"{path}: no such recording")
    try:
        with warnings.catch_warnings():
            # A run cut off leaves a .part without a footer; its status reports that it was cut off.
            warnings.simplefilter("ignore", RerunWarning)
            try:
                return read(RrdReader(path), True)
            except (RuntimeError, ValueError, IndexError):
                if not path.name.endswith(".part"):  # Rerun reads what is cut between two messages as if it were whole
                    raise
                with _whole_messages(path) as whole:
                    return read(RrdReader(whole), False)
    except (RuntimeError, ValueError, OSError, IndexError) as error:
        torn = any(words in str(error) for words in _TORN)
        found = f", found one that was cut off{_ADVICE}" if torn else f": {error}"
        raise InputError(f"{path}: expected a whole Rerun recording{found}") from None


@contextmanager
def _whole_messages(path: Path) -> Iterator[Path]:
    """Yield the file where its last message is whole, else a copy without the incomplete message."""
    with path.open("rb") as file, TemporaryDirectory() as folder:
        if (end := end_of_whole(file)) == os.fstat(file.fileno()).st_size:
            yield path
            return
        shutil.copyfile(path, copy := Path(folder, path.name))
        os.truncate(copy, end)
        yield copy


HEAD = 12
"""Bytes before an .rrd's first message; each has 16 bytes (kind, length) and its content. The format is not documented;
this was tested with rerun-sdk 0.41."""
_END = 0
"""Kind of the last message, the index of the others, which a file that was cut off does not have."""


def end_of_whole(file: BinaryIO, begin: int = HEAD) -> int:
    """Return the offset of the end of the last whole message before the index; begin: of the first message read."""
    size, place = os.fstat(file.fileno()).st_size, begin
    while place + 16 <= size:
        file.seek(place)
        kind, length = struct.unpack("<QQ", file.read(16))
        if kind == _END or place + 16 + length > size:
            break
        place += 16 + length
    return place


def static_values(chunks: Iterable[Chunk]) -> dict[str, dict[str, Any]]:
    """Return the last static value by entity path and component, as Arrow."""
    static: dict[str, dict[str, Any]] = {}
    for chunk in chunks:
        if chunk.is_static:
            batch = chunk.to_record_batch()
            names = [name for name in batch.schema.names if not name.startswith("rerun.")]
            columns = {name: batch.column(name).drop_null() for name in names}
            values = {name: column[-1] for name, column in columns.items() if len(column)}
            static.setdefault(chunk.entity_path.removeprefix("/"), {}).update(values)
    return static


def curves(chunks: Iterable[Chunk], component: str = SCALARS) -> dict[str, Curve]:
    """Return the numbers of a component over frames by entity path."""
    pieces: dict[str, list[tuple[IntArray, FloatArray]]] = {}
    for chunk in chunks:
        if not chunk.is_static and component in (batch := chunk.to_record_batch()).schema.names:
            frames = np.asarray(batch.column("frame"), dtype=np.int64)
            values = np.asarray(batch.column(component).flatten(), dtype=np.float64)
            piece = frames, values.reshape(len(frames), -1)
            pieces.setdefault(chunk.entity_path.removeprefix("/"), []).append(piece)
    joined: dict[str, Curve] = {}
    for entity, parts in pieces.items():
        frames, values = (np.concatenate(part) for part in zip(*parts, strict=True))
        order = np.argsort(frames, kind="stable")
        joined[entity] = Curve(frames[order], values[order])
    return joined


def cells(
    path: Path, contents: Sequence[str], frames: Sequence[int] | None = None, components: Sequence[str] | None = None
) -> dict[str, dict[str, dict[int, Any]]]:
    """Return values that are not static by entity path, component and frame, as Arrow; component "time": frames' times.

    frames: the frames to read; None: all. components: as of `read_chunks`, which also raises the InputErrors.
    """
    table: dict[str, dict[str, dict[int, Any]]] = {}
    for chunk in read_chunks(path, contents, components):
        if chunk.is_static:
            continue
        batch = chunk.to_record_batch()
        numbers = batch.column("frame").to_pylist()
        for name in batch.schema.names:
            if ":" in name or name == "time":
                column = table.setdefault(chunk.entity_path.removeprefix("/"), {}).setdefault(name, {})
                values = zip(numbers, batch.column(name), strict=True)
                wanted = ((frame, value) for frame, value in values if frames is None or frame in frames)
                column |= {frame: value for frame, value in wanted if value.is_valid}
    return table


def flat(cell: Any) -> FloatArray:
    """Return all numbers in a cell of nested lists, (n,); none where there is no cell."""
    if cell is None or not len(cell):
        return np.empty(0)
    values = cell.values
    while pa.types.is_nested(values.type):
        values = values.flatten()
    return np.asarray(values, dtype=np.float64)


_TIMED = {
    "poses": ("estimate/pose", SCALARS),
    "joints": ("world/estimate/joints", "Points3D:positions"),
    "true_joints": ("world/truth/joints", "Points3D:positions"),
}


def timed(path: Path, name: str) -> tuple[IntArray, FloatArray, FloatArray]:
    """Return frames (F,), ascending, times (F,), s, and values of the frames that have them; F may be 0.

    name: poses (F, P), or joints or true_joints (F, J, 3), m, as float32.
    """
    entity, component = _TIMED[name]
    with sound(path):
        columns = cells(path, [f"/{entity}"]).get(entity, {})
        values = {frame: cell.as_py() for frame, cell in sorted(columns.get(component, {}).items()) if len(cell)}
        times_ns = np.array([columns["time"][frame].value for frame in values], dtype=np.float64)
        return np.array([*values], dtype=np.int64), times_ns / 1e9, np.array([*values.values()], dtype=np.float64)


def properties(static: Mapping[str, Mapping[str, Any]]) -> dict[str, dict[str, Any]]:
    """Return the properties among `static_values` by name, as Python values; a list of one item as the item."""
    by_name: dict[str, dict[str, Any]] = {}
    for entity, components in static.items():
        if entity.startswith("__properties/"):
            lists = {key: value.as_py() for key, value in components.items()}
            plain = {key: values[0] if len(values) == 1 else values for key, values in lists.items()}
            by_name[entity.removeprefix("__properties/")] = plain
    return by_name
