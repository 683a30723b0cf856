"""Collect the values of frames and write them as columns: making an archetype takes longer than its numbers."""

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cache
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
    """Values of one entity in one frame. kind: an archetype's class. fields: by the names of its `columns`, arrays or
    lists of equal length, 0 to show nothing; of a BarChart the values (B,)."""

    kind: Any
    fields: Mapping[str, AnyArray | Sequence[Any]]

    @property
    def n_bytes(self) -> int:
        """Total size of the arrays, bytes."""
        lists = (field if isinstance(field, list) else [field] for field in self.fields.values())
        return sum(each.nbytes for field in lists for each in field if isinstance(each, np.ndarray))


Rows: TypeAlias = Iterator[tuple[str, Row]]


def curves(values: Mapping[str, float | FloatArray]) -> Rows:
    """Yield one frame's numbers, {entity path: a number or an array (k,)}, as rows of float64 scalars."""
    for path, value in values.items():
        yield path, Row(rr.Scalars, {"scalars": np.atleast_1d(np.array(value, dtype=np.float64))})


def nanoseconds(time_s: float) -> np.timedelta64:
    """Return a time in seconds as recordings hold it."""
    return np.timedelta64(round(time_s * 1e9), "ns")


def time_index(frames: Iterable[int], times: Iterable[np.timedelta64]) -> list[rr.TimeColumn]:
    """Return the timelines `frame` and `time` of rows."""
    return [rr.TimeColumn("frame", sequence=[*frames]), rr.TimeColumn("time", duration=np.array([*times]))]


class Columns:
    """Rows per entity path, waiting to be written. A path's rows are of one kind and have the same fields."""

    def __init__(self) -> None:
        self._rows: dict[str, list[tuple[int, np.timedelta64, Row]]] = {}
        self._n_bytes: dict[str, int] = {}  # of the rows that wait
        self._numbers: dict[tuple[str, ...], list[tuple[int, np.timedelta64, FloatArray]]] = {}

    def add(self, frame: int, time: np.timedelta64, rows: Iterable[tuple[str, Row]]) -> None:
        """Add rows of entities in one frame: pairs (entity path, row)."""
        for path, row in rows:
            self._rows.setdefault(path, []).append((frame, time, row))
            self._n_bytes[path] = self._n_bytes.get(path, 0) + row.n_bytes

    def add_numbers(self, frame: int, time: np.timedelta64, numbers: Mapping[str, float]) -> None:
        """Add one frame's numbers, {entity path: number}, as `curves` would, in a tenth of its time and memory."""
        values = np.array([*numbers.values()], dtype=np.float64)
        self._numbers.setdefault(tuple(numbers), []).append((frame, time, values))

    def write(self, stream: rr.RecordingStream, least_bytes: int = 0) -> None:
        """Send what waits; least_bytes: only the rows of paths, such as images, that take at least so many bytes."""
        indexes: dict[tuple[int, ...], list[rr.TimeColumn]] = {}  # most entities have rows in all frames
        for path in [path for path, n_bytes in self._n_bytes.items() if n_bytes >= least_bytes]:
            frames, times, rows = zip(*self._rows.pop(path), strict=True)
            del self._n_bytes[path]
            if frames not in indexes:
                indexes[frames] = time_index(frames, times)
            stream.send_columns(path, indexes=indexes[frames], columns=_columns(rows))
        if not least_bytes:
            self._write_numbers(stream)

    def _write_numbers(self, stream: rr.RecordingStream) -> None:
        numbers, self._numbers = self._numbers, {}
        descriptor, _ = _component(rr.Scalars, "scalars")
        for paths, rows in numbers.items():
            frames, times, values = zip(*rows, strict=True)
            index, n = time_index(frames, times), len(frames)
            ends, flat = pa.array(np.arange(n + 1, dtype=np.int32)), pa.array(np.stack(values, axis=1).ravel())
            for k, path in enumerate(paths):
                scalars: Any = _Column(descriptor, pa.ListArray.from_arrays(ends, flat.slice(k * n, n)))
                stream.send_columns(path, indexes=index, columns=[scalars])


@dataclass(frozen=True)
class _Column:
    """A component's values, a list for each row, as Rerun takes them; making its own classes takes longer."""

    descriptor: Any
    values: pa.Array

    def component_descriptor(self) -> Any:
        return self.descriptor

    def as_arrow_array(self) -> pa.Array:
        return self.values


def _columns(rows: Sequence[Row]) -> list[Any]:
    kind = rows[0].kind
    if kind is rr.BarChart:
        batch = rr.components.TensorDataBatch(_tensors(np.array([row.fields["values"] for row in rows])))
        return [rr.ComponentColumn(rr.BarChart.descriptor_values(), batch)]
    columns = []
    for name in rows[0].fields:
        parts = [row.fields[name] for row in rows]
        ends = pa.array(np.cumsum([0, *map(len, parts)]).astype(np.int32))
        joined = np.concatenate(parts) if isinstance(parts[0], np.ndarray) else list(chain.from_iterable(parts))
        descriptor, batch = _component(kind, name)
        values = _strips(np.asarray(joined)) if name == "strips" else batch(joined).as_arrow_array()
        columns.append(_Column(descriptor, pa.ListArray.from_arrays(ends, values)))
    return columns


@cache
def _component(kind: Any, field: str) -> tuple[Any, Any]:
    """Return the component of an archetype's field, and the class that makes arrays of it."""
    descriptor = getattr(kind, f"descriptor_{field}")()
    return descriptor, getattr(rr.components, f"{descriptor.component_type.rpartition('.')[2]}Batch")


def _strips(places: AnyArray) -> pa.Array:
    """Return strips (n, length, 2 or 3) as Rerun's array, made ten times as fast as by Rerun."""
    n, length, dimensions = places.shape
    flat = pa.array(np.asarray(places, dtype=np.float32).ravel())
    batch: Any = {2: rr.components.LineStrip2DBatch, 3: rr.components.LineStrip3DBatch}[dimensions]
    kind = batch([]).as_arrow_array().type
    points = pa.FixedSizeListArray.from_arrays(flat, type=kind.value_type)
    return pa.ListArray.from_arrays(np.arange(n + 1, dtype=np.int32) * np.int32(length), points, type=kind)


def _tensors(values: FloatArray) -> pa.Array:
    """Return the values (F, B) of F bar charts as Rerun's array; one by one, Rerun takes ten times as long."""
    n, size = values.shape
    empty = pa.concat_arrays([rr.components.TensorDataBatch(np.zeros(size)).as_arrow_array()] * n)
    buffer = empty.field("buffer")  # a union, with one field for each type of numbers
    fields = [buffer.field(k) for k in range(buffer.type.num_fields)]
    (own,) = (k for k in range(len(fields)) if buffer.type.field(k).name == "F64")
    ends, numbers = np.arange(n + 1, dtype=np.int32) * np.int32(size), pa.array(values.ravel())
    fields[own] = pa.ListArray.from_arrays(ends, numbers, type=buffer.type.field(own).type)
    buffer = pa.Array.from_buffers(buffer.type, n, buffer.buffers()[:3], children=fields)
    return pa.Array.from_buffers(empty.type, n, [None], children=[empty.field(0), empty.field(1), buffer])
