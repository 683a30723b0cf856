"""Buffers of frames' values, written as columns, since one archetype per value would be slow."""

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import chain
from typing import Any, TypeAlias

import numpy as np
import pyarrow as pa  # type: ignore[import-untyped]
import rerun as rr

from workbench.utils.arrays import AnyArray, FloatArray

Entities: TypeAlias = Iterator[tuple[str, rr.AsComponents | Iterable[rr.DescribedComponentBatch]]]
"""Pairs (entity path, archetype), to be logged one by one."""


@dataclass(frozen=True, eq=False)
class Row:
    """Values of one entity in one frame.

    kind: class of the archetype. fields: arrays or lists of equal length by the names of its `columns`, of length 0 to
    clear the entity; of a BarChart the values (B,).
    """

    kind: Any
    fields: Mapping[str, AnyArray | Sequence[Any]]

    @property
    def n_bytes(self) -> int:
        """Total size of the arrays, bytes."""
        lists = (field if isinstance(field, list) else [field] for field in self.fields.values())
        return sum(each.nbytes for field in lists for each in field if isinstance(each, np.ndarray))


DRAWS = "Draws"
"""Name of the archetype of one frame's samples of the motion (S, P), S · P numbers in its one component, "poses"."""
_SCALARS = rr.Scalars.descriptor_scalars()
_STRIPS = {rr.LineStrips2D: rr.components.LineStrip2DBatch, rr.LineStrips3D: rr.components.LineStrip3DBatch}
Rows: TypeAlias = Iterator[tuple[str, Row]]


def nanoseconds(time_s: float) -> np.timedelta64:
    """Return a time, s, in the recordings' unit."""
    return np.timedelta64(round(time_s * 1e9), "ns")


def time_index(frames: Iterable[int], times: Iterable[np.timedelta64]) -> list[rr.TimeColumn]:
    """Return the timelines `frame` and `time` of rows."""
    return [rr.TimeColumn("frame", sequence=[*frames]), rr.TimeColumn("time", duration=np.array([*times]))]


class Columns:
    """Buffered rows by entity path. A path's rows are of one kind and have the same fields."""

    def __init__(self) -> None:
        self._rows: dict[str, list[tuple[int, np.timedelta64, Row]]] = {}
        self._n_bytes: dict[str, int] = {}  # of the buffered rows
        self._numbers: dict[tuple[str, ...], list[tuple[int, np.timedelta64, FloatArray]]] = {}

    def add(self, frame: int, time: np.timedelta64, rows: Iterable[tuple[str, Row]]) -> None:
        """Add rows of entities in one frame: pairs (entity path, row)."""
        for path, row in rows:
            self._rows.setdefault(path, []).append((frame, time, row))
            self._n_bytes[path] = self._n_bytes.get(path, 0) + row.n_bytes

    def add_numbers(self, frame: int, time: np.timedelta64, numbers: Mapping[str, float]) -> None:
        """Add one frame's numbers, {entity path: number}, in a tenth of the time and memory of rows."""
        values = np.array([*numbers.values()], dtype=np.float64)
        self._numbers.setdefault(tuple(numbers), []).append((frame, time, values))

    def write(self, stream: rr.RecordingStream, min_bytes: int = 0) -> None:
        """Send the buffered rows; min_bytes: only those of paths, such as images, with at least so many bytes."""
        indexes: dict[tuple[int, ...], list[rr.TimeColumn]] = {}  # most entities have rows in all frames
        for path in [path for path, n_bytes in self._n_bytes.items() if n_bytes >= min_bytes]:
            frames, times, rows = zip(*self._rows.pop(path), strict=True)
            del self._n_bytes[path]
            if frames not in indexes:
                indexes[frames] = time_index(frames, times)
            stream.send_columns(path, indexes=indexes[frames], columns=_columns(rows))
        if not min_bytes:
            self._write_numbers(stream)

    def _write_numbers(self, stream: rr.RecordingStream) -> None:
        numbers, self._numbers = self._numbers, {}
        for paths, rows in numbers.items():
            frames, times, values = zip(*rows, strict=True)
            index = time_index(frames, times)
            for path, curve in zip(paths, np.stack(values, axis=1), strict=True):  # faster than Scalars.columns
                column = rr.ComponentColumn(_SCALARS, rr.components.ScalarBatch(curve))
                stream.send_columns(path, indexes=index, columns=[column])


def _columns(rows: Sequence[Row]) -> rr.ComponentColumnList:
    kind = rows[0].kind
    if kind is rr.BarChart:  # whose class takes one row only
        tensors = [rr.components.TensorDataBatch(row.fields["values"]).as_arrow_array() for row in rows]
        batch = rr.components.TensorDataBatch(pa.concat_arrays(tensors))
        return rr.ComponentColumnList([rr.ComponentColumn(kind.descriptor_values(), batch)])
    fields = {name: [row.fields[name] for row in rows] for name in rows[0].fields}
    joined: dict[str, Any] = {
        name: np.concatenate(parts) if isinstance(parts[0], np.ndarray) else list(chain.from_iterable(parts))
        for name, parts in fields.items()
    }
    if kind in _STRIPS:
        joined["strips"] = _strip_array(_STRIPS[kind], joined["strips"])
    lengths = [len(part) for part in next(iter(fields.values()))]
    if kind is rr.DynamicArchetype:  # a class of the workbench's own numbers, by name
        ones = {name: _single_numbers(numbers) for name, numbers in joined.items()}
        return rr.DynamicArchetype.columns(archetype=DRAWS, components=ones).partition(lengths)
    batches = kind.from_fields(**joined).as_component_batches()
    return rr.ComponentColumnList([batch.partition(lengths) for batch in batches])


def _single_numbers(numbers: AnyArray) -> Any:
    """Return numbers (n,) as the Arrow array of n lists of one, into which Rerun would convert them in Python."""
    return pa.ListArray.from_arrays(np.arange(len(numbers) + 1, dtype=np.int32), pa.array(numbers))


def _strip_array(batch: Any, strips: AnyArray) -> Any:
    """Return strips (n, k, D) as the Arrow array of a component, whose own conversion loops over strips in Python."""
    n, k, _ = strips.shape
    kind = batch([]).as_arrow_array().type
    points = pa.FixedSizeListArray.from_arrays(pa.array(strips.ravel()), type=kind.value_type)
    return pa.ListArray.from_arrays(pa.array(np.arange(n + 1, dtype=np.int32) * k), points, type=kind)
