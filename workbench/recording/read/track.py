"""The expected poses, their joints and the true joints of a recording, with their times."""

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

from workbench.arrays import FloatArray, IntArray
from workbench.recording.read.chunks import read_chunks

Timed = tuple[IntArray, FloatArray, FloatArray]
"""Frames (F,), ascending; times (F,), s; one value for each, (F, ...)."""


def timed_poses(path: Path) -> Timed:
    """Frames, times and expected poses (F, P) of a recording that `reader.read` accepts."""
    return _timed(path, "/estimate/pose", "Scalars:scalars")


def timed_joints(path: Path) -> Timed:
    """Frames, times and joints of the expected poses (F, J, 3), m, to float32."""
    return _timed(path, "/world/estimate/joints", "Points3D:positions")


def timed_true_joints(path: Path) -> Timed:
    """Frames, times and true joints (F, J, 3), m, to float32, of the frames that have them (F may be zero)."""
    return _timed(path, "/world/truth/joints", "Points3D:positions")


def _timed(path: Path, entity: str, component: str) -> Timed:
    rows = sorted(_rows(path, entity, component), key=lambda row: row[0])
    frames = np.array([frame for frame, _, _ in rows], dtype=np.int64)
    times_s = np.array([time_ns for _, time_ns, _ in rows], dtype=np.float64) / 1e9
    return frames, times_s, np.array([value for _, _, value in rows], dtype=np.float64)


def _rows(path: Path, entity: str, component: str) -> Iterator[tuple[int, int, list[Any]]]:
    """(frame, time in ns, value) of every frame where the component holds something."""
    for chunk in read_chunks(path, [entity]):
        batch = chunk.to_record_batch()
        if not chunk.is_static and component in batch.schema.names:
            columns = (batch.column("frame"), batch.column("time").cast("int64"), batch.column(component))
            for frame, time_ns, value in zip(*(column.to_pylist() for column in columns), strict=True):
                if value:
                    yield frame, time_ns, value
