"""What the frames show, collected and written as columns: to make an archetype takes longer than the numbers in it."""

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import chain
from typing import Any, TypeAlias

import numpy as np
import pyarrow as pa  # type: ignore[import-untyped]
import rerun as rr

from workbench.arrays import AnyArray, FloatArray


@dataclass(frozen=True, eq=False)
class Row:
    """What one entity shows in one frame. kind: an archetype's class. fields: by the names of its `columns`, arrays or
    lists of equal length, 0 to show nothing; of a BarChart the values (B,)."""

    kind: Any
    fields: Mapping[str, AnyArray | Sequence[Any]]

    def __len__(self) -> int:
        return len(next(iter(self.fields.values())))


Rows: TypeAlias = Iterator[tuple[str, Row]]


class Columns:
    """Rows per entity path, waiting to be written. A path's rows are of one kind and have the same fields."""

    def __init__(self) -> None:
        self._waiting: dict[str, list[tuple[int, np.timedelta64, Row]]] = {}

    def add(self, frame: int, time: np.timedelta64, rows: Iterable[tuple[str, Row]]) -> None:
        """What entities show in one frame: pairs (entity path, row)."""
        for path, row in rows:
            self._waiting.setdefault(path, []).append((frame, time, row))

    def write(self, stream: rr.RecordingStream) -> None:
        """Send what waits on the timelines `frame` and `time`."""
        for path, waiting in self._waiting.items():
            frames, times, rows = zip(*waiting, strict=True)
            indexes = [rr.TimeColumn("frame", sequence=frames), rr.TimeColumn("time", duration=np.array(times))]
            stream.send_columns(path, indexes=indexes, columns=_columns(rows))
        self._waiting.clear()


def _columns(rows: Sequence[Row]) -> Iterable[Any]:
    kind = rows[0].kind
    if kind is rr.BarChart:
        values = np.array([row.fields["values"] for row in rows], dtype=np.float64)
        batch = rr.components.TensorDataBatch(_tensors(values))
        return [rr.ComponentColumn(rr.BarChart.descriptor_values(), batch)]
    fields = {name: _joined([row.fields[name] for row in rows]) for name in rows[0].fields}
    columns: Iterable[Any] = kind.columns(**fields).partition([len(row) for row in rows])
    return columns


def _joined(parts: Sequence[AnyArray | Sequence[Any]]) -> AnyArray | list[Any]:
    if isinstance(parts[0], np.ndarray):
        return np.concatenate([np.asarray(part) for part in parts])
    return list(chain.from_iterable(parts))


def _tensors(values: FloatArray) -> Any:
    """Rows (F, B) as F tensors in Arrow, of which Rerun itself makes only one at a time."""
    n, size = values.shape
    type_ = rr.components.TensorDataBatch._ARROW_DATATYPE
    shape, names, buffer = (type_.field(k) for k in range(3))
    code = [field.name for field in buffer.type].index("F64")
    ends = pa.array(np.arange(n + 1, dtype=np.int32) * size)
    numbers = pa.ListArray.from_arrays(ends, pa.array(values.ravel()), type=buffer.type[code].type)
    buffers = [None, pa.py_buffer(np.full(n, code, dtype=np.int8)), pa.py_buffer(np.arange(n, dtype=np.int32))]
    children = [numbers if k == code else pa.nulls(0, field.type) for k, field in enumerate(buffer.type)]
    union = pa.Array.from_buffers(buffer.type, n, buffers, children=children)
    columns = [pa.array([[size]] * n, type=shape.type), pa.nulls(n, type=names.type), union]
    return pa.StructArray.from_arrays(columns, fields=[shape, names, buffer])
