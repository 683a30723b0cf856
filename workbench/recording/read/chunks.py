"""What lies in a Rerun file: its static values and its curves."""

import warnings
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

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


def read_chunks(path: Path, contents: Sequence[str]) -> list[Chunk]:
    """The chunks of the entities `contents`, such as /metrics/**, of an .rrd or of what a run cut off left.

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
    return {entity: _joined(found) for entity, found in pieces.items()}


def _joined(pieces: Sequence[tuple[IntArray, FloatArray]]) -> Curve:
    frames, values = (np.concatenate(part) for part in zip(*pieces, strict=True))
    order = np.argsort(frames, kind="stable")
    return Curve(frames[order], values[order])


def properties(static: Mapping[str, Mapping[str, Any]]) -> dict[str, dict[str, Any]]:
    """Select those of `static_values` that are properties, by name, as Python values."""
    return {
        entity.removeprefix("__properties/"): {key: _plain(value) for key, value in values.items()}
        for entity, values in static.items()
        if entity.startswith("__properties/")
    }


def _plain(value: Any) -> Any:
    """A property's Arrow list as a Python value, alone when it holds one."""
    values = value.as_py()
    return values[0] if len(values) == 1 else values
