"""Frames in which a track is lost and recovered, by errors and thresholds."""

from collections.abc import Mapping

import numpy as np

from workbench.utils.arrays import BoolArray, FloatArray
from workbench.utils.crossings import WINDOW_FRAMES, Series, crossings

TRACKED_MM = 150.0
"""Threshold of the mean joint error of a track in space, half a head: of the root-aligned error where images show the
person, whose depth one camera hardly observes, else of the absolute error."""
UNCERTAIN_MM = 450.0
"""Expected error from which on a group of joints, or a depth, is uncertain: the distance between the shoulders, 0.26 of
an adult's height (Drillis & Contini 1966), beyond which the estimate and the person do not overlap."""


def lost_states(errors: Series, thresholds: Series, window: int = WINDOW_FRAMES) -> BoolArray:
    """Return whether each frame (F,) lies between a loss and the next recovery, or the end: the losses and recoveries
    are in turn the `crossings` of the errors (F,)."""
    lost = np.zeros(len(errors), dtype=bool)
    for k, frame in enumerate(crossings(errors, thresholds, window)):
        lost[frame:] = k % 2 == 0
    return lost


def criteria(errors: Mapping[str, Series]) -> dict[str, tuple[FloatArray, FloatArray]]:
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


def lost_frames(errors: Mapping[str, Series]) -> BoolArray | None:
    """Return whether the track is lost in each frame (F,) by any of its `criteria`; None without any."""
    lost = [lost_states(*each) for each in criteria(errors).values()]
    return np.asarray(np.any(lost, axis=0)) if lost else None


def track_metrics(errors: Mapping[str, Series]) -> dict[str, float]:
    """Return n_track_losses, tracked (0 or 1) and lost_fraction of a track's errors, see `lost_frames`; {} without."""
    if (lost := lost_frames(errors)) is None or not len(lost):
        return {}
    n = float((lost & ~np.concatenate([[False], lost[:-1]])).sum())
    return {"n_track_losses": n, "tracked": float(n == 0.0), "lost_fraction": float(lost.mean())}
