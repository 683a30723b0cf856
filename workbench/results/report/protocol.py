"""Runs of a protocol by what people do and are shown with, and how well stated doubts predict errors."""

from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np
import pandas as pd

from workbench.evaluation.expected_error import LARGE_MM, area_under_curve, spearman
from workbench.evaluation.step_calibration import GROUPS
from workbench.recording.read.reader import Run
from workbench.results.report.groups import Group
from workbench.results.report.people import half_of
from workbench.utils.arrays import FloatArray

_METRICS = ("held", "error_px", "error_rel_mm", "error_abs_mm", "coverage_90", "ms_per_frame")
_BY: Mapping[str, Callable[[Mapping[str, Any]], object]] = {
    "activity": lambda settings: settings["protocol"].get("activity"),
    "shown with": lambda settings: settings["protocol"].get("shown"),
    "camera at": lambda settings: f"{settings['dataset'].get('view_deg', 0.0):g}°",
}


def divided(groups: Sequence[Group]) -> dict[str, pd.DataFrame]:
    """Return tables of a protocol's runs by what it varied, and of how well their doubts predict large errors."""
    of_protocol = [group for group in groups if group.runs and half_of(group.runs[0].settings) is not None]
    if not of_protocol:
        return {}
    means = {f"by {word}: means over runs": pd.concat([_means(group, word) for group in of_protocol]) for word in _BY}
    return means | {f"stated doubt against true errors, and against those over {LARGE_MM:g} mm": _trust(of_protocol)}


def _means(group: Group, word: str) -> pd.DataFrame:
    by = pd.Index([str(_BY[word](run.settings)) for run in group.runs], name=word)
    runs = group.numbers.reindex(columns=list(_METRICS)).set_axis(by).groupby(word)
    table = runs.mean().reset_index()
    table.insert(0, "group", group.label)
    table.insert(2, "n", runs.size().to_numpy())
    return table


def _trust(groups: Sequence[Group]) -> pd.DataFrame:
    rows = []
    for group in groups:
        for joints in GROUPS:
            stated, errors = _pooled(group.runs, joints)
            if len(errors):
                large = errors > LARGE_MM
                rows.append({
                    "group": group.label, "joints": joints, "frames": len(errors), "stated mm": stated.mean(),
                    "true mm": errors.mean(), "large": large.mean(), "Spearman": spearman(stated, errors),
                    "AUC": area_under_curve(stated, large),
                })  # fmt: skip
    return pd.DataFrame(rows)


def _pooled(runs: Sequence[Run], joints: str) -> tuple[FloatArray, FloatArray]:
    """Return what all runs stated and missed (n,), mm, of a group of joints, in all frames but the given first ones."""
    names = f"doubt_{joints}_mm", f"missed_{joints}_mm"
    series = [[run.metric(name)[1][1:] for name in names] for run in runs if set(names) <= set(run.metric_names)]
    stated, missed = np.concatenate([np.zeros((2, 0)), *map(np.array, series)], axis=1)
    return stated, missed
