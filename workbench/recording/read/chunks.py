"""What lies in a Rerun file: its static values, its curves and what it shows frame by frame."""

import os
import shutil
import struct
import warnings
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, BinaryIO, TypeAlias

import numpy as np
import pyarrow as pa  # type: ignore[import-untyped]
from rerun.chunk import Chunk, RrdReader
from rerun.error_utils import RerunWarning

from workbench.utils.arrays import FloatArray, IntArray
from workbench.utils.errors import InputError

DAMAGES = (
    pa.ArrowException, ArithmeticError, AttributeError, LookupError, MemoryError, RuntimeError, TypeError, ValueError,
)  # fmt: skip
"""What turning another's values into ours ends with, where they are of other kinds."""


EVERYTHING = ("/**", "/__properties/**")
"""What is to be read for all that a recording holds."""


@dataclass(frozen=True, eq=False)
class Curve:
    """Numbers over frames. frames: (F,), ascending; values: (F, k)."""

    frames: IntArray
    values: FloatArray


Timed: TypeAlias = tuple[IntArray, FloatArray, FloatArray]
"""Frames (F,), ascending; times (F,), s; one value for each, (F, ...)."""

_TORN = ("exceeds file size", "without footer")
_ADVICE = "; `rerun rrd optimize FILE -o WHOLE.rrd` saves what comes before the cut"


@contextmanager
def sound(path: Path) -> Iterator[None]:
    """Make an InputError, which names the recording, of what goes wrong in making numbers of what lies in it."""
    try:
        yield
    except InputError:
        raise
    except DAMAGES as error:
        told = " ".join(f"{type(error).__name__}: {error}".split())
        raise InputError(f"{path}: expected values of the kinds that runs record, found others: {told}") from None


def read_chunks(path: Path, contents: Sequence[str]) -> list[Chunk]:
    """Read the chunks of the entities `contents`, such as /metrics/**, of an .rrd or of what a run cut off left.

    Of a .part, what a run cut off left, all whole messages are read. Raises InputError when there is no such file, or
    it is not a recording, or it is cut and no .part.
    """
    if not path.is_file():
        raise InputError(f"{path}: no such recording")
    try:
        with warnings.catch_warnings():
            # A run cut off leaves a .part without a footer; that it was cut off is what its status says.
            warnings.simplefilter("ignore", RerunWarning)
            return _read(path, list(contents))
    except (RuntimeError, ValueError, OSError) as error:
        torn = any(words in str(error) for words in _TORN)
        found = f", found one that was cut off{_ADVICE}" if torn else f": {error}"
        raise InputError(f"{path}: expected a whole Rerun recording{found}") from None


def recording_of(path: Path) -> tuple[str, str]:
    """Tell of which application and which recording, by its id, an .rrd or what a run cut off left is; raises
    InputError as `read_chunks`."""
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", RerunWarning)
            return _recording_of(path)
    except (RuntimeError, ValueError, OSError, IndexError) as error:
        raise InputError(f"{path}: expected a whole Rerun recording: {error}") from None


def _recording_of(path: Path) -> tuple[str, str]:
    try:
        store = RrdReader(path).recordings()[0]
    except (RuntimeError, ValueError, IndexError):
        if not path.name.endswith(".part"):
            raise
        with _whole_messages(path) as whole:
            store = RrdReader(whole).recordings()[0]
    return store.application_id, store.recording_id


def _read(path: Path, contents: list[str]) -> list[Chunk]:
    try:  # by the footer: nothing else is read
        return RrdReader(path).store().stream().filter(content=contents).to_chunks()
    except (RuntimeError, ValueError):
        if not path.name.endswith(".part"):  # Rerun reads what is cut between two messages as if it were whole
            raise
        with _whole_messages(path) as whole:
            return RrdReader(whole).stream().filter(content=contents).to_chunks()


@contextmanager
def _whole_messages(path: Path) -> Iterator[Path]:
    """Give the file where it is whole up to its end, else a copy without what was being written when the run ended."""
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
    """Return the offset where the last whole message ends, the index left out; begin: where to start looking."""
    size, place = os.fstat(file.fileno()).st_size, begin
    while place + 16 <= size:
        file.seek(place)
        kind, length = struct.unpack("<QQ", file.read(16))
        if kind == _END or place + 16 + length > size:
            break
        place += 16 + length
    return place


def static_values(chunks: Iterable[Chunk]) -> dict[str, dict[str, Any]]:
    """Collect, by entity path and then by component, the last value that is static, as Arrow."""
    found: dict[str, dict[str, Any]] = {}
    for chunk in chunks:
        if chunk.is_static:
            batch = chunk.to_record_batch()
            names = [name for name in batch.schema.names if not name.startswith("rerun.")]
            columns = {name: batch.column(name).drop_null() for name in names}
            values = {name: column[-1] for name, column in columns.items() if len(column)}
            found.setdefault(chunk.entity_path.removeprefix("/"), {}).update(values)
    return found


def curves(chunks: Iterable[Chunk]) -> dict[str, Curve]:
    """Collect by entity path the scalars over frames."""
    pieces: dict[str, list[tuple[IntArray, FloatArray]]] = {}
    for chunk in chunks:
        if not chunk.is_static and "Scalars:scalars" in (batch := chunk.to_record_batch()).schema.names:
            frames = np.asarray(batch.column("frame"), dtype=np.int64)
            values = np.asarray(batch.column("Scalars:scalars").flatten(), dtype=np.float64)
            piece = frames, values.reshape(len(frames), -1)
            pieces.setdefault(chunk.entity_path.removeprefix("/"), []).append(piece)
    found: dict[str, Curve] = {}
    for entity, parts in pieces.items():
        frames, values = (np.concatenate(part) for part in zip(*parts, strict=True))
        order = np.argsort(frames, kind="stable")
        found[entity] = Curve(frames[order], values[order])
    return found


def cells(
    path: Path, contents: Sequence[str], frames: Iterable[int] | None = None
) -> dict[str, dict[str, dict[int, Any]]]:
    """Read by entity path, component and frame what is there and not static, as Arrow, and as "time" the frames' times.

    frames: only these; None: all. Raises InputError as `read_chunks` does.
    """
    wanted = None if frames is None else set(frames)
    found: dict[str, dict[str, dict[int, Any]]] = {}
    for chunk in read_chunks(path, contents):
        if chunk.is_static:
            continue
        batch = chunk.to_record_batch()
        numbers = batch.column("frame").to_pylist()
        rows = [row for row, frame in enumerate(numbers) if wanted is None or frame in wanted]
        for name in batch.schema.names if rows else ():
            if ":" in name or name == "time":
                column = found.setdefault(chunk.entity_path.removeprefix("/"), {}).setdefault(name, {})
                column |= {numbers[row]: batch.column(name)[row] for row in rows if batch.column(name)[row].is_valid}
    return found


def timed_poses(path: Path) -> Timed:
    """Read frames, times and expected poses (F, P) of a recording that `reader.read` accepts."""
    return _timed(path, "estimate/pose", "Scalars:scalars")


def timed_joints(path: Path) -> Timed:
    """Read frames, times and joints of the expected poses (F, J, 3), m, to float32."""
    return _timed(path, "world/estimate/joints", "Points3D:positions")


def timed_true_joints(path: Path) -> Timed:
    """Read frames, times and true joints (F, J, 3), m, to float32, of the frames that have them (F may be zero)."""
    return _timed(path, "world/truth/joints", "Points3D:positions")


def _timed(path: Path, entity: str, component: str) -> Timed:
    with sound(path):
        return _timed_values(cells(path, [f"/{entity}"]).get(entity, {}), component)


def _timed_values(found: Mapping[str, Mapping[int, Any]], component: str) -> Timed:
    values = {frame: cell.as_py() for frame, cell in sorted(found.get(component, {}).items()) if len(cell)}
    times_ns = np.array([found["time"][frame].value for frame in values], dtype=np.float64)
    return np.array([*values], dtype=np.int64), times_ns / 1e9, np.array([*values.values()], dtype=np.float64)


def properties(static: Mapping[str, Mapping[str, Any]]) -> dict[str, dict[str, Any]]:
    """Select those of `static_values` that are properties, by name, as Python values, a list of one as its item."""
    found: dict[str, dict[str, Any]] = {}
    for entity, components in static.items():
        if entity.startswith("__properties/"):
            lists = {key: value.as_py() for key, value in components.items()}
            plain = {key: values[0] if len(values) == 1 else values for key, values in lists.items()}
            found[entity.removeprefix("__properties/")] = plain
    return found
