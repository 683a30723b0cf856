"""Frames in which a series crosses a threshold and stays there, as a loss and a recovery."""

from collections.abc import Sequence

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view

from workbench.utils.arrays import FloatArray

WINDOW_FRAMES = 5
"""Frames over which values are averaged, so that a single frame is no crossing."""

Series = Sequence[float] | FloatArray


def crossings(values: Series, thresholds: Series, window: int = WINDOW_FRAMES) -> list[int]:
    """Return the frames in which a series reaches its thresholds and falls below them, in turn.

    The thresholds are reached where the mean value over `window` frames reaches the mean threshold. The frame is the
    first of these that reaches its own threshold, after the last crossing. The series is below them where its mean is
    below the mean threshold again. A series that begins with large values reaches them in frame 0.

    Parameters
    ----------
    values, thresholds : (F,) in one unit; NaN where unknown, which is ignored.
    window : frames.
    """
    excess = np.asarray(values, dtype=np.float64) - np.asarray(thresholds, dtype=np.float64)
    places = np.flatnonzero(np.isfinite(excess))
    frames: list[int] = []
    n = max(1, min(window, len(places)))
    windows = np.ascontiguousarray(sliding_window_view(places, n)) if len(places) else np.empty((0, n), np.int64)
    for among, reached in zip(windows, (excess[windows].mean(axis=1) >= 0.0).tolist(), strict=True):
        if reached is (len(frames) % 2 == 0):
            crossed = among[((excess[among] >= 0.0) == reached) & (among > (frames[-1] if frames else -1))]
            frames += crossed[:1].tolist()
    return frames
