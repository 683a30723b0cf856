"""Collect what the frames show and write it as columns: an archetype takes longer to make than the numbers in it.

Interruptions wait while rows are sent: frames are then whole in the file, and nothing is sent twice.
"""

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from itertools import chain
from typing import Any, TypeAlias

import numpy as np
import pyarrow as pa  # type: ignore[import-untyped]
import rerun as rr

from workbench.utils.arrays import AnyArray, FloatArray
from workbench.utils.signals import deferred

Entities: TypeAlias = Iterator[tuple[str, rr.AsComponents | Iterable[rr.DescribedComponentBatch]]]
"""Pairs (entity path, archetype), to be logged one by one."""


@dataclass(frozen=True, eq=False)
class Row:
    """What one entity shows in one frame. kind: an archetype's class. fields: by the names of its `columns`, arrays or
    lists of equal length, 0 to show nothing; of a BarChart the values (B,)."""

    kind: Any
    fields: Mapping[str, AnyArray | Sequence[Any]]

    def __len__(self) -> int:
        return len(next(iter(self.fields.values())))

    @property
    def n_bytes(self) -> int:
        """Of its arrays."""
        lists = (field if isinstance(field, list) else [field] for field in self.fields.values())
        return sum(each.nbytes for field in lists for each in field if isinstance(each, np.ndarray))


Rows: TypeAlias = Iterator[tuple[str, Row]]


def curves(values: Mapping[str, float | FloatArray]) -> Rows:
    """Yield one frame's numbers, {entity path: a number or an array (k,)}, as rows of float64 scalars."""
    for path, value in values.items():
        yield path, Row(rr.Scalars, {"scalars": np.atleast_1d(np.array(value, dtype=np.float64))})


class Columns:
    """Rows per entity path, waiting to be written. A path's rows are of one kind and have the same fields."""

    def __init__(self) -> None:
        self._waiting: dict[str, list[tuple[int, np.timedelta64, Row]]] = {}
        self._n_bytes: dict[str, int] = {}  # of the rows that wait
        self._numbers: dict[tuple[str, ...], list[tuple[int, np.timedelta64, FloatArray]]] = {}

    def add(self, frame: int, time: np.timedelta64, rows: Iterable[tuple[str, Row]]) -> None:
        """Take in what entities show in one frame: pairs (entity path, row)."""
        for path, row in rows:
            self._waiting.setdefault(path, []).append((frame, time, row))
            self._n_bytes[path] = self._n_bytes.get(path, 0) + row.n_bytes

    def add_numbers(self, frame: int, time: np.timedelta64, numbers: Mapping[str, float]) -> None:
        """Take in one frame's numbers, {entity path: number}: what `curves` makes of them, in a tenth of its time, and
        of the room that they take until they are written."""
        values = np.array([*numbers.values()], dtype=np.float64)
        self._numbers.setdefault(tuple(numbers), []).append((frame, time, values))

    def write_large(self, stream: rr.RecordingStream, least_bytes: int) -> None:
        """Send the rows of paths, such as images, that take at least so many bytes."""
        for path in [path for path, n_bytes in self._n_bytes.items() if n_bytes >= least_bytes]:
            with deferred():
                large = Columns()
                large._waiting[path] = self._waiting.pop(path)
                del self._n_bytes[path]
                large.write(stream)

    def write(self, stream: rr.RecordingStream) -> None:
        """Send what waits on the timelines `frame` and `time`."""
        with deferred():
            self._write_rows(stream)
            self._write_numbers(stream)

    def _write_rows(self, stream: rr.RecordingStream) -> None:
        indexes: dict[tuple[int, ...], list[rr.TimeColumn]] = {}  # most entities have rows in all frames
        rows_by_path, self._waiting = self._waiting, {}
        self._n_bytes.clear()
        for path, waiting in rows_by_path.items():
            frames, times, rows = zip(*waiting, strict=True)
            if frames not in indexes:
                indexes[frames] = _index(frames, times)
            stream.send_columns(path, indexes=indexes[frames], columns=_columns(rows))

    def _write_numbers(self, stream: rr.RecordingStream) -> None:
        """Send what was taken in by `add_numbers` alone."""
        numbers, self._numbers = self._numbers, {}
        for paths, rows in numbers.items():
            frames, times, values = zip(*rows, strict=True)
            index, n = _index(frames, times), len(frames)
            ends, flat = pa.array(np.arange(n + 1, dtype=np.int32)), pa.array(np.stack(values, axis=1).ravel())
            descriptor, _ = _component(rr.Scalars, "scalars")
            for k, path in enumerate(paths):
                scalars: Any = _Column(descriptor, pa.ListArray.from_arrays(ends, flat.slice(k * n, n)))
                stream.send_columns(path, indexes=index, columns=[scalars])


@dataclass(frozen=True)
class _Column:
    """A component's values, a list for each row, as Rerun takes them: making its own classes of them takes longer than
    sending them."""

    descriptor: Any
    values: pa.Array

    def component_descriptor(self) -> Any:
        return self.descriptor

    def as_arrow_array(self) -> pa.Array:
        return self.values


def _index(frames: Sequence[int], times: Sequence[np.timedelta64]) -> list[rr.TimeColumn]:
    return [rr.TimeColumn("frame", sequence=frames), rr.TimeColumn("time", duration=np.array(times))]


def _columns(rows: Sequence[Row]) -> list[Any]:
    kind = rows[0].kind
    if kind is rr.BarChart:
        batch = rr.components.TensorDataBatch(_tensors(np.array([row.fields["values"] for row in rows])))
        return [rr.ComponentColumn(rr.BarChart.descriptor_values(), batch)]
    ends = pa.array(np.cumsum([0, *map(len, rows)]).astype(np.int32))
    found = []
    for name, first in rows[0].fields.items():
        parts = [row.fields[name] for row in rows]
        given = np.concatenate(parts) if isinstance(first, np.ndarray) else list(chain.from_iterable(parts))
        descriptor, batch = _component(kind, name)
        values = _strips(np.asarray(given)) if name == "strips" else batch(given).as_arrow_array()
        found.append(_Column(descriptor, pa.ListArray.from_arrays(ends, values)))
    return found


@cache
def _component(kind: Any, field: str) -> tuple[Any, Any]:
    """The component that a field of an archetype is, and what makes arrays of it."""
    descriptor = getattr(kind, f"descriptor_{field}")()
    return descriptor, getattr(rr.components, f"{descriptor.component_type.rpartition('.')[2]}Batch")


def _strips(places: AnyArray) -> pa.Array:
    """What Rerun makes of strips (n, length, 2 or 3), one by one, which takes ten times as long."""
    n, length, dimensions = places.shape
    flat = pa.array(np.asarray(places, dtype=np.float32).ravel())
    kind = _strip_type(dimensions)
    points = pa.FixedSizeListArray.from_arrays(flat, type=kind.value_type)
    return pa.ListArray.from_arrays(np.arange(n + 1, dtype=np.int32) * np.int32(length), points, type=kind)


@cache
def _strip_type(dimensions: int) -> pa.DataType:
    batch: Any = {2: rr.components.LineStrip2DBatch, 3: rr.components.LineStrip3DBatch}[dimensions]
    return batch([]).as_arrow_array().type


def _tensors(values: FloatArray) -> pa.Array:
    """What Rerun makes of the values (F, B) of F bar charts, one by one, which takes ten times as long."""
    n, size = values.shape
    empty = pa.concat_arrays([_tensor(size)] * n)
    buffer = empty.field("buffer")  # a union, of which the numbers' type tells the field
    fields = [buffer.field(k) for k in range(buffer.type.num_fields)]
    (own,) = (k for k in range(len(fields)) if buffer.type.field(k).name == "F64")
    ends, numbers = np.arange(n + 1, dtype=np.int32) * np.int32(size), pa.array(values.ravel())
    fields[own] = pa.ListArray.from_arrays(ends, numbers, type=buffer.type.field(own).type)
    buffer = pa.Array.from_buffers(buffer.type, n, buffer.buffers()[:3], children=fields)
    return pa.Array.from_buffers(empty.type, n, [None], children=[empty.field(0), empty.field(1), buffer])


@cache
def _tensor(size: int) -> pa.Array:
    return rr.components.TensorDataBatch(np.zeros(size)).as_arrow_array()
