"""Frames in which a track is lost and recovered, by errors and thresholds."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

WINDOW_FRAMES = 5
"""Frames over which an error is averaged, so that a single frame is neither a loss nor a recovery."""


@dataclass(frozen=True)
class TrackEvent:
    """A loss or a recovery of the track. kind: "lost" or "recovered". frame: index of its first frame in the run."""

    kind: str
    frame: int


def track_events(errors: Sequence[float], thresholds: Sequence[float], window: int = WINDOW_FRAMES) -> list[TrackEvent]:
    """Return the losses and recoveries of a track, which alternate.

    The track is lost where the mean error over `window` frames reaches the mean threshold. The event is the first of
    these frames that reaches its own threshold, after the last event. The track is recovered where the mean error is
    below the mean threshold again. A run that begins with large errors is lost in frame 0.

    Parameters
    ----------
    errors, thresholds : (F,) in one unit; NaN where unknown, which is ignored.
    window : frames.
    """
    excess = np.asarray(errors, dtype=np.float64) - np.asarray(thresholds, dtype=np.float64)
    places = np.flatnonzero(np.isfinite(excess))
    events: list[TrackEvent] = []
    last = -1
    for end in range(max(1, min(window, len(places))), len(places) + 1):
        among = places[max(0, end - window) : end]
        lost = bool(excess[among].mean() >= 0.0)
        crossed = among[((excess[among] >= 0.0) == lost) & (among > last)]
        if lost is (len(events) % 2 == 0) and len(crossed):
            last = int(crossed[0])
            events.append(TrackEvent("lost" if lost else "recovered", last))
    return events


def lost_fraction(errors: Sequence[float], thresholds: Sequence[float], window: int = WINDOW_FRAMES) -> float:
    """Return the fraction of the frames between a loss and the next recovery, or the end; see `track_events`."""
    frames = [event.frame for event in track_events(errors, thresholds, window)]
    ends = [*frames, len(errors)] if len(frames) % 2 else frames
    return float(np.diff(np.array(ends).reshape(-1, 2), axis=1).sum()) / max(len(errors), 1)
