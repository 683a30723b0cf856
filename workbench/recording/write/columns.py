"""Collect what the frames show and write it as columns: an archetype takes longer to make than the numbers in it."""

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import chain
from typing import Any, TypeAlias

import numpy as np
import pyarrow as pa  # type: ignore[import-untyped]
import rerun as rr

from workbench.arrays import AnyArray, FloatArray

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


Rows: TypeAlias = Iterator[tuple[str, Row]]


def curves(values: Mapping[str, float | FloatArray]) -> Rows:
    """Yield one frame's numbers, {entity path: a number or an array (k,)}, as rows of float64 scalars."""
    for path, value in values.items():
        yield path, Row(rr.Scalars, {"scalars": np.atleast_1d(np.array(value, dtype=np.float64))})


class Columns:
    """Rows per entity path, waiting to be written. A path's rows are of one kind and have the same fields."""

    def __init__(self) -> None:
        self._waiting: dict[str, list[tuple[int, np.timedelta64, Row]]] = {}

    def add(self, frame: int, time: np.timedelta64, rows: Iterable[tuple[str, Row]]) -> None:
        """Take in what entities show in one frame: pairs (entity path, row)."""
        for path, row in rows:
            self._waiting.setdefault(path, []).append((frame, time, row))

    def write(self, stream: rr.RecordingStream) -> None:
        """Send what waits on the timelines `frame` and `time`."""
        indexes: dict[tuple[int, ...], list[rr.TimeColumn]] = {}  # most entities have rows in all frames
        for path, waiting in self._waiting.items():
            frames, times, rows = zip(*waiting, strict=True)
            if frames not in indexes:
                time = rr.TimeColumn("time", duration=np.array(times))
                indexes[frames] = [rr.TimeColumn("frame", sequence=frames), time]
            stream.send_columns(path, indexes=indexes[frames], columns=_columns(rows))
        self._waiting.clear()


def _columns(rows: Sequence[Row]) -> Iterable[Any]:
    kind = rows[0].kind
    if kind is rr.BarChart:  # of its values Rerun makes only one at a time
        tensors = [rr.components.TensorDataBatch(row.fields["values"]).as_arrow_array() for row in rows]
        batch = rr.components.TensorDataBatch(pa.concat_arrays(tensors))
        return [rr.ComponentColumn(rr.BarChart.descriptor_values(), batch)]
    fields: dict[str, AnyArray | list[Any]] = {}
    for name, first in rows[0].fields.items():
        parts = [row.fields[name] for row in rows]
        fields[name] = np.concatenate(parts) if isinstance(first, np.ndarray) else list(chain.from_iterable(parts))
    return kind.columns(**fields).partition([len(row) for row in rows])
