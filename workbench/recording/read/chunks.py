"""What lies in a Rerun file: its static values, its curves and what it shows frame by frame."""

import warnings
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, TypeAlias

import numpy as np
from rerun.chunk import Chunk, RrdReader
from rerun.error_utils import RerunWarning

from workbench.arrays import FloatArray, IntArray
from workbench.errors import InputError


@dataclass(frozen=True, eq=False)
class Curve:
    """Numbers over frames. frames: (F,), ascending; values: (F, k)."""

    frames: IntArray
    values: FloatArray


Timed: TypeAlias = tuple[IntArray, FloatArray, FloatArray]
"""Frames (F,), ascending; times (F,), s; one value for each, (F, ...)."""


def read_chunks(path: Path, contents: Sequence[str]) -> list[Chunk]:
    """Read the chunks of the entities `contents`, such as /metrics/**, of an .rrd or of what a run cut off left.

    Raises InputError when there is no such file, or it is not a recording, or it is torn inside a message.
    """
    if not path.is_file():
        raise InputError(f"{path}: no such recording")
    try:
        with warnings.catch_warnings():
            # A recording cut off has no footer; that it was cut off is what its status says.
            warnings.simplefilter("ignore", RerunWarning)
            return _read(RrdReader(path), list(contents))
    except (RuntimeError, ValueError, OSError) as error:
        torn = "exceeds file size" in str(error)
        advice = "; `rerun rrd optimize FILE -o WHOLE.rrd` saves what comes before the tear" if torn else ""
        raise InputError(f"{path}: expected a whole Rerun recording: {error}{advice}") from None


def _read(reader: RrdReader, contents: list[str]) -> list[Chunk]:
    try:
        return reader.store().stream().filter(content=contents).to_chunks()  # by the footer: nothing else is read
    except (RuntimeError, ValueError):
        return reader.stream().filter(content=contents).to_chunks()


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
    found = cells(path, [f"/{entity}"]).get(entity, {})
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
