"""Runs of a protocol by activity, scene and camera, and the prediction of errors by expected errors."""

from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np
import pandas as pd

from workbench.evaluation.metrics import HEADLINE
from workbench.evaluation.uncertainty.step_calibration import GROUPS, LARGE_MM, area_under_curve, spearman
from workbench.recording.read.reader import Run
from workbench.results.report.groups import Grouping
from workbench.utils.arrays import FloatArray

_BY: Mapping[str, Callable[[Mapping[str, Any]], object]] = {
    "activity": lambda settings: settings["protocol"].get("activity"),
    "occlusion": lambda settings: settings["protocol"].get("occlusion"),
    "camera at": lambda settings: f"{settings['dataset'].get('view_azimuth_deg', 0.0):g}°",
}


def divided(grouping: Grouping) -> dict[str, pd.DataFrame]:
    """Return tables of a protocol's runs by its variables, and of expected against true errors."""
    runs = grouping.runs[grouping.runs["half"] != "None"]
    if runs.empty:
        return {}
    shown = [name for name in grouping.metrics if name in HEADLINE]
    metrics = grouping.values.pivot(index="recording", columns="metric", values="value").reindex(columns=shown)
    tables = {}
    for word, value_of in _BY.items():
        by = runs[["group", "recording"]].assign(**{word: [str(value_of(run.settings)) for run in runs["run"]]})
        rows = by.join(metrics, on="recording").groupby(["group", word])
        means = pd.concat([rows.size().rename("n"), rows[shown].mean()], axis="columns").reset_index()
        tables[f"by {word}: means over runs"] = grouping.labelled(means)
    title = f"expected against true errors, and against those over {LARGE_MM:g} mm"
    return tables | {title: grouping.labelled(_error_prediction(runs))}


def _error_prediction(runs: pd.DataFrame) -> pd.DataFrame:
    rows = []
    for group, members in runs.groupby("group")["run"]:
        for joints in GROUPS:
            expected, errors = _pooled(list(members), joints)
            if len(errors):
                large = errors > LARGE_MM
                scores = spearman(expected, errors), area_under_curve(expected, large)
                rows.append((group, joints, len(errors), expected.mean(), errors.mean(), large.mean(), *scores))
    header = ("group", "joints", "frames", "expected mm", "true mm", "large", "Spearman", "AUC")
    return pd.DataFrame(rows, columns=header)


def _pooled(runs: Sequence[Run], joints: str) -> tuple[FloatArray, FloatArray]:
    """Return all runs' expected and true errors (n,), mm, of a group of joints, in the frames after the first."""
    names = f"expected_error_{joints}_mm", f"mpjpe_abs_{joints}_mm"
    series = [[run.metric(name)[1][1:] for name in names] for run in runs if set(names) <= set(run.metric_names)]
    expected, errors = np.concatenate([np.zeros((2, 0)), *map(np.array, series)], axis=1)
    return expected, errors
