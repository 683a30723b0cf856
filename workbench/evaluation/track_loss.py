"""Frames in which a track is lost and recovered, by errors and thresholds."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from workbench.utils.arrays import BoolArray

FOREARM_OVER_HEIGHT = 0.044
"""A forearm's width over a person's height, the mean of the two ends of `from_height`: the threshold of a track in the
image."""
TRACKED_MM = 150.0
"""Threshold of the mean joint error of a track in space: half a head. Where images show the person, a
larger error makes frames doubtful, as the depth of one camera is uncertain."""
LOST_MM = 450.0
"""Mean joint error from which on a track is lost although it agrees with the image: the distance between the shoulders,
0.26 of an adult's height (Drillis & Contini 1966), beyond which the estimate and the person do not overlap."""
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


def lost_states(errors: Sequence[float], thresholds: Sequence[float], window: int = WINDOW_FRAMES) -> BoolArray:
    """Return whether each frame (F,) lies between a loss and the next recovery, or the end; see `track_events`."""
    lost = np.zeros(len(errors), dtype=bool)
    for event in track_events(errors, thresholds, window):
        lost[event.frame :] = event.kind == "lost"
    return lost


def lost_frames(errors: Mapping[str, Sequence[float]]) -> BoolArray | None:
    """Return whether the track is lost in each frame (F,), by the image and in space; None without a threshold.

    errors: series over frames by name. In the image mpjpe_px is compared with forearm_width_px. In space mpjpe_abs_mm
    is compared with LOST_MM, or with TRACKED_MM without images.
    """
    in_space = errors.get("mpjpe_abs_mm")
    if "mpjpe_px" in errors and "forearm_width_px" in errors:
        lost = lost_states(errors["mpjpe_px"], errors["forearm_width_px"])
        if in_space is not None and len(in_space) == len(lost):
            lost |= lost_states(in_space, [LOST_MM] * len(lost))
        return lost
    return None if in_space is None else lost_states(in_space, [TRACKED_MM] * len(in_space))


def track_metrics(errors: Mapping[str, Sequence[float]]) -> dict[str, float]:
    """Return n_track_losses, tracked (0 or 1) and lost_fraction of a track's errors, see `lost_frames`; {} without."""
    if (lost := lost_frames(errors)) is None or not len(lost):
        return {}
    n = float((lost & ~np.concatenate([[False], lost[:-1]])).sum())
    return {"n_track_losses": n, "tracked": float(n == 0.0), "lost_fraction": float(lost.mean())}
