"""When a tracker loses the person, and when it finds them again."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

WINDOW = 5
"""Frames over which an error is averaged, so that a single one neither loses nor finds anybody; as in `errors.held`."""


@dataclass(frozen=True)
class Event:
    """frame: the place in the sequence of the first frame from which on the person was lost, or was held again."""

    kind: str
    frame: int


def lost_and_found(errors: Sequence[float], thresholds: Sequence[float], window: int = WINDOW) -> list[Event]:
    """Return the events "lost" and "found", which alternate, of errors and their thresholds (F,), in one unit.

    Lost: the mean error over `window` frames reaches the mean threshold; the event is the first of these frames that
    does, after the last event. Found: it is below again. Errors that are not known (NaN) say nothing. A run that begins
    lost loses in 0.
    """
    apart = np.asarray(errors, dtype=np.float64) - np.asarray(thresholds, dtype=np.float64)
    places = np.flatnonzero(np.isfinite(apart))
    events: list[Event] = []
    last = -1
    for end in range(max(1, min(window, len(places))), len(places) + 1):
        among = places[max(0, end - window) : end]
        lost = bool(apart[among].mean() >= 0.0)
        crossed = among[((apart[among] >= 0.0) == lost) & (among > last)]
        if lost is (len(events) % 2 == 0) and len(crossed):
            last = int(crossed[0])
            events.append(Event("lost" if lost else "found", last))
    return events


def lost_share(errors: Sequence[float], thresholds: Sequence[float], window: int = WINDOW) -> float:
    """Return the part of the frames that lie between a loss and the next find, or the end."""
    marks = [event.frame for event in lost_and_found(errors, thresholds, window)]
    ends = [*marks, len(errors)] if len(marks) % 2 else marks
    return float(np.diff(np.array(ends).reshape(-1, 2), axis=1).sum()) / max(len(errors), 1)
