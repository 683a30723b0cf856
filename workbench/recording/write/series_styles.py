"""How curves look and what they are called: the estimate orange, as everywhere, and each title with its unit."""

from collections.abc import Iterable, Sequence
from itertools import cycle

import rerun as rr

from workbench.recording.write import colours
from workbench.recording.write.columns import Entities

_ESTIMATE = ("expected pose", colours.ESTIMATE, 2.5)
_HEAVIEST = ("heaviest particle", colours.HEAVIEST_PARTICLE, 1.0)
_CURVES = {
    "error_abs_mm": _ESTIMATE,
    "error_abs_mm_map": _HEAVIEST,
    "error_rel_mm": ("pelvis on pelvis", colours.SERIES[3], 1.0),
    "error_offset_free_mm": ("without markers' offsets", colours.MODEL, 1.0),
    "error_procrustes_mm": ("best similarity (PA)", colours.SERIES[0], 1.0),
    "error_px": _ESTIMATE,
    "error_px_map": _HEAVIEST,
    "forearm_px": ("lost above this, a forearm's width", colours.MODEL, 1.5),
}
"""Metrics that share a plot with others: (name in the legend, colour, width)."""

DOUBTS = {"head": ("green", 0), "arms": ("red", 1), "legs": ("blue", 2), "root": ("pink", 3)}
"""Groups of joints: the colour's name, and its number in the series."""
_CURVES |= {f"doubt_{group}_mm": (group, colours.SERIES[k], 2.5) for group, (_, k) in DOUBTS.items()}
_CURVES |= {f"missed_{group}_mm": (f"{group}, in truth", colours.SERIES[k], 0.7) for group, (_, k) in DOUBTS.items()}

GUIDES = {"coverage_90": 0.9}
"""What a metric should be: a line in its plot."""
_GUIDE = "guides"

_TITLES = {
    "error_abs_mm": "distance from the true joints (mm)",
    "error_rel_mm": "the same, pelvis moved onto pelvis (mm)",
    "error_px": "distance in the image (pixels)",
    "jump_deg": "largest change of a joint angle (degrees)",
    "same_activity": "drawn of the same activity (1: all)",
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
    for name in metrics:
        label, colour, width = _look(name, metrics)
        yield f"metrics/{name}", rr.SeriesLines(colors=[colour], widths=[width], names=[label])
        if name in GUIDES:
            yield f"{_GUIDE}/{name}", rr.SeriesLines(colors=[colours.MODEL], widths=[1.5], names=["what is right"])


def guides(metrics: Iterable[str]) -> dict[str, float]:
    """Return what those of a frame's metrics should be, by entity path."""
    return {f"{_GUIDE}/{name}": GUIDES[name] for name in metrics if name in GUIDES}


def marks(name: str, metrics: Sequence[str]) -> rr.SeriesPoints:
    """Return the style of a metric that few frames have, among all `metrics`: marks, which no line joins."""
    label, colour, _ = _look(name, metrics)
    return rr.SeriesPoints(colors=[colour], markers="circle", marker_sizes=[4.0], names=[label])


def _look(name: str, metrics: Sequence[str]) -> tuple[str, tuple[int, int, int], float]:
    cues = dict(zip(shares(metrics), cycle(colours.SERIES)))
    if name in cues:
        return title(name), cues[name], 2.0
    return _CURVES.get(name, (title(name), colours.ESTIMATE, 2.0))


def title(name: str, unit: str = "") -> str:
    """Return a metric's or parameter's name as words, with its unit."""
    words = _TITLES.get(name, name.replace("_", " "))
    unit = "degrees" if unit == "rad" else unit  # in which angles are drawn
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
