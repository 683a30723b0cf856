"""Runs of a protocol, divided: its halves, what people do and are shown with; and whether stated doubts tell errors."""

from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np

from workbench.evaluation.step_calibration import GROUPS, LARGE_MM, area_under_curve, spearman
from workbench.recording.read.reader import Run
from workbench.results.report.tables import Table, number
from workbench.utils.arrays import FloatArray

PROTOCOL = "protocol"
SHOWN = ("dataset.view_deg", "dataset.first_frame", "dataset.occluder", "protocol.activity", "protocol.shown")
"""Keys that the protocol draws for every clip and seed, so that they do not tell groups of runs apart."""
_METRICS = ("held", "error_px", "error_rel_mm", "error_abs_mm", "coverage_90", "ms_per_frame")
_BY: Mapping[str, Callable[[Mapping[str, Any]], object]] = {
    "activity": lambda settings: settings[PROTOCOL].get("activity"),
    "shown with": lambda settings: settings[PROTOCOL].get("shown"),
    "camera at": lambda settings: f"{settings['dataset'].get('view_deg', 0.0):g}°",
}


def half_of(settings: Mapping[str, Any]) -> str | None:
    """Name the half of its protocol's clips that a run belongs to; None where there is no protocol."""
    half = (settings.get(PROTOCOL) or {}).get("half")
    return None if half is None else str(half)


def divided(groups: Mapping[str, Sequence[Run]]) -> list[tuple[str, Table]]:
    """Tabulate the runs of groups, by their labels, by what the protocol varied, and how well their doubts tell large
    errors; nothing of groups without a protocol."""
    kept = {label: runs for label, runs in groups.items() if runs and half_of(runs[0].settings) is not None}
    if not kept:
        return []
    tables = [(f"by {word}: means over runs", _by(word, kept)) for word in _BY]
    return [*tables, (f"stated doubt against true errors, and against those over {LARGE_MM:g} mm", _trust(kept))]


def _by(word: str, groups: Mapping[str, Sequence[Run]]) -> Table:
    rows = []
    for label, runs in groups.items():
        found: dict[str, list[Run]] = {}
        for run in runs:
            found.setdefault(str(_BY[word](run.settings)), []).append(run)
        rows += [
            (label, name, str(len(own)), *(_mean(own, metric) for metric in _METRICS))
            for name, own in sorted(found.items())
        ]
    return Table(("group", word, "n", *_METRICS), tuple(rows), frozenset(("n", *_METRICS)))


def _mean(runs: Sequence[Run], metric: str) -> str:
    values = [float({**run.result, **run.properties.get("cost", {})}.get(metric, np.nan)) for run in runs]
    known = np.array(values)[np.isfinite(values)]
    return number(float(known.mean())) if len(known) else number(np.nan)


def _trust(groups: Mapping[str, Sequence[Run]]) -> Table:
    rows = []
    for label, runs in groups.items():
        for joints in GROUPS:
            stated, errors = _pooled(runs, joints)
            if len(errors):
                large = errors > LARGE_MM
                told = spearman(stated, errors), area_under_curve(stated, large)
                means = stated.mean(), errors.mean(), large.mean()
                rows.append((label, joints, str(len(errors)), *map(number, (*means, *told))))
    header = ("group", "joints", "frames", "stated mm", "true mm", "large", "Spearman", "AUC")
    return Table(header, tuple(rows), frozenset(header[2:]))


def _pooled(runs: Sequence[Run], joints: str) -> tuple[FloatArray, FloatArray]:
    """What all runs stated and missed (n,), mm, of a group of joints, frame by frame; not in first frames, which are
    given."""
    names = f"doubt_{joints}_mm", f"missed_{joints}_mm"
    series = [[run.metric(name)[1][1:] for name in names] for run in runs if set(names) <= set(run.metric_names)]
    both = [
        np.concatenate(each) if series else np.zeros(0) for each in (zip(*series, strict=True) if series else ((), ()))
    ]
    return both[0], both[1]
