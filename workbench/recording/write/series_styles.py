"""How curves look and what they are called: the estimate orange, as everywhere, and each title with its unit."""

from collections.abc import Sequence
from itertools import cycle

import rerun as rr

from workbench.recording.write import colours
from workbench.recording.write.columns import Entities

_ESTIMATE = ("expected pose", colours.ESTIMATE, 2.5)
_HEAVIEST = ("heaviest particle", colours.HEAVIEST_PARTICLE, 1.0)
_MOVED = ("pelvis moved onto pelvis", colours.PELVIS_ON_PELVIS, 1.0)
_CURVES = {
    "error_abs_mm": _ESTIMATE,
    "error_abs_mm_map": _HEAVIEST,
    "error_rel_mm": _MOVED,
    "error_offset_free_mm": ("markers' offsets removed", colours.MODEL, 1.0),
    "error_procrustes_mm": ("turned, moved and scaled onto the truth", colours.PARTS[2], 1.0),
    "error_px": _ESTIMATE,
    "error_px_map": _HEAVIEST,
    "forearm_px": ("lost above this, a forearm's width", colours.MODEL, 1.0),
}
"""Metrics that share a plot with others: (name in the legend, colour, width)."""

_DOUBTS = {"root": 0, "head": 1, "arms": 2, "legs": 3}
_CURVES |= {f"doubt_{group}_mm": (group, colours.PARTS[k], 2.0) for group, k in _DOUBTS.items()}
_CURVES |= {f"missed_{group}_mm": (f"{group}, in truth", colours.PARTS[k], 0.7) for group, k in _DOUBTS.items()}

_TITLES = {
    "error_abs_mm": "distance from the true joints (mm)",
    "error_rel_mm": "the same, pelvis moved onto pelvis (mm)",
    "error_px": "distance in the image (pixels)",
    "coverage_90": "truth inside the 5–95 % bands (0.9 is right)",
    "crps_mm": "CRPS of the root's position (mm)",
    "crps_deg": "CRPS of the angles (degrees)",
    "log_score": "−log p(true pose), mean over its numbers (nats)",
    "ess": "effective sample size",
    "log_evidence": "log evidence of all frames so far",
    "knee_deg": "error of the knees' flexion (degrees)",
    "hip_deg": "error of the hips' flexion (degrees)",
    "activity_accuracy": "activity told right (1: yes)",
}


def fixed(metrics: Sequence[str]) -> Entities:
    """Yield the styles of the curves of `metrics`, to be logged static."""
    cues = {name: (title(name), colour, 2.0) for name, colour in zip(shares(metrics), cycle(colours.PARTS))}
    for name in metrics:
        label, colour, width = cues.get(name) or _CURVES.get(name, (title(name), colours.ESTIMATE, 2.0))
        yield f"metrics/{name}", rr.SeriesLines(colors=[colour], widths=[width], names=[label])


def title(name: str, unit: str = "") -> str:
    """Return a metric's or parameter's name as words, with its unit."""
    words = _TITLES.get(name, name.replace("_", " "))
    return f"{words} ({unit})" if unit not in ("", "1") else words


def errors_mm(metrics: Sequence[str]) -> list[str]:
    """Select those of the metrics that are errors in the world."""
    return [name for name in metrics if name.startswith("error") and name.removesuffix("_map").endswith("_mm")]


def errors_px(metrics: Sequence[str]) -> list[str]:
    """Select those of the metrics that are errors in the image, and what they are measured by."""
    found = [name for name in metrics if name.startswith("error") and "px" in name.split("_")]
    return [*found, *(name for name in metrics if found and name == "forearm_px")]


def doubts(metrics: Sequence[str]) -> list[str]:
    """Select what the posterior says of its errors, and these errors, by joint group."""
    return [name for name in metrics if name.startswith(("doubt_", "missed_"))]


def shares(metrics: Sequence[str]) -> list[str]:
    """Select those of the metrics that are the parts of cues."""
    return [name for name in metrics if name.startswith("share_")]
