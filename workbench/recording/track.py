"""The expected poses and the true joints of a recording, with their times."""

import warnings
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
from rerun.chunk import RrdReader
from rerun.error_utils import RerunWarning

from workbench.arrays import FloatArray, IntArray

Timed = tuple[IntArray, FloatArray, FloatArray]
"""Frames (F,), ascending; times (F,), s; one value for each, (F, ...)."""


def timed_poses(path: Path) -> Timed:
    """Frames, times and expected poses (F, P) of a recording that `reader.read` accepts."""
    return _timed(path, "/estimate/pose", "Scalars:scalars")


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
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", RerunWarning)  # a run cut off has no footer; `read` says how it ended
        chunks = RrdReader(path).stream().filter(content=entity, is_static=False).to_chunks()
    for chunk in chunks:
        batch = chunk.to_record_batch()
        if component in batch.schema.names:
            columns = (batch.column("frame"), batch.column("time").cast("int64"), batch.column(component))
            for frame, time_ns, value in zip(*(column.to_pylist() for column in columns), strict=True):
                if value:
                    yield frame, time_ns, value
