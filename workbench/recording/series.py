"""Scalars over the frames, collected and written as columns: one write per curve instead of one per value."""

from collections.abc import Mapping

import numpy as np
import rerun as rr

from workbench.arrays import FloatArray

_SCALARS = rr.Scalars.descriptor_scalars()


class Series:
    """Rows of numbers per entity path, waiting to be written."""

    def __init__(self) -> None:
        self._rows: dict[str, list[tuple[int, np.timedelta64, FloatArray]]] = {}

    def add(self, frame: int, time: np.timedelta64, values: Mapping[str, float | FloatArray]) -> None:
        """One frame's numbers: {entity path: a number or an array (k,)}."""
        for path, value in values.items():
            row = np.atleast_1d(np.array(value, dtype=np.float64))
            self._rows.setdefault(path, []).append((frame, time, row))

    def write(self, stream: rr.RecordingStream) -> None:
        """Send what waits, float64, on the timelines `frame` and `time`."""
        indexes: dict[tuple[int, ...], list[rr.TimeColumn]] = {}  # most curves have the same frames
        for path, rows in self._rows.items():
            frames, times, values = zip(*rows, strict=True)
            if frames not in indexes:
                time = rr.TimeColumn("time", duration=np.array(times))
                indexes[frames] = [rr.TimeColumn("frame", sequence=frames), time]
            batch = rr.components.ScalarBatch(np.concatenate(values))
            column = rr.ComponentColumn(_SCALARS, batch, lengths=[len(row) for row in values])
            stream.send_columns(path, indexes=indexes[frames], columns=[column])
        self._rows.clear()
