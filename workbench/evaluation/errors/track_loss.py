"""Frames in which a track is lost and recovered, by errors and thresholds."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from workbench.utils.arrays import BoolArray, FloatArray

FOREARM_OVER_HEIGHT = 0.044
"""A forearm's width over a person's height, the mean of the two ends of `from_height`: the threshold of a track in the
image."""
TRACKED_MM = 150.0
"""Threshold of the mean joint error of a track in space, half a head: of the root-aligned error where images show the
person, whose depth one camera hardly observes, else of the absolute error."""
UNCERTAIN_MM = 450.0
"""Expected error from which on a group of joints, or a depth, is uncertain: the distance between the shoulders, 0.26 of
an adult's height (Drillis & Contini 1966), beyond which the estimate and the person do not overlap."""
WINDOW_FRAMES = 5
"""Frames over which an error is averaged, so that a single frame is neither a loss nor a recovery."""

_Series = Sequence[float] | FloatArray


@dataclass(frozen=True)
class TrackEvent:
    """A loss or a recovery of the track. kind: "lost" or "recovered". frame: index of its first frame in the run."""

    kind: str
    frame: int


def track_events(errors: _Series, thresholds: _Series, window: int = WINDOW_FRAMES) -> list[TrackEvent]:
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


def lost_states(errors: _Series, thresholds: _Series, window: int = WINDOW_FRAMES) -> BoolArray:
    """Return whether each frame (F,) lies between a loss and the next recovery, or the end; see `track_events`."""
    lost = np.zeros(len(errors), dtype=bool)
    for event in track_events(errors, thresholds, window):
        lost[event.frame :] = event.kind == "lost"
    return lost


def criteria(errors: Mapping[str, _Series]) -> dict[str, tuple[FloatArray, FloatArray]]:
    """Return the errors that decide whether a track is lost, by name, each with its thresholds, (F,); {} without any.

    errors: series over frames by name. Where images show the person these are mpjpe_px with forearm_width_px, and
    mpjpe_mm with TRACKED_MM; else mpjpe_abs_mm with TRACKED_MM.
    """
    in_image = "mpjpe_px" in errors and "forearm_width_px" in errors
    pairs = {"mpjpe_px": np.asarray(errors["forearm_width_px"], np.float64)} if in_image else {}
    n, in_space = len(errors["mpjpe_px"]) if in_image else None, "mpjpe_mm" if in_image else "mpjpe_abs_mm"
    if in_space in errors and n in (None, len(errors[in_space])):
        pairs[in_space] = np.full(len(errors[in_space]), TRACKED_MM)
    return {name: (np.asarray(errors[name], np.float64), thresholds) for name, thresholds in pairs.items()}


def lost_frames(errors: Mapping[str, _Series]) -> BoolArray | None:
    """Return whether the track is lost in each frame (F,) by any of its `criteria`; None without any."""
    lost = [lost_states(*each) for each in criteria(errors).values()]
    return np.asarray(np.any(lost, axis=0)) if lost else None


def track_metrics(errors: Mapping[str, _Series]) -> dict[str, float]:
    """Return n_track_losses, tracked (0 or 1) and lost_fraction of a track's errors, see `lost_frames`; {} without."""
    if (lost := lost_frames(errors)) is None or not len(lost):
        return {}
    n = float((lost & ~np.concatenate([[False], lost[:-1]])).sum())
    return {"n_track_losses": n, "tracked": float(n == 0.0), "lost_fraction": float(lost.mean())}
