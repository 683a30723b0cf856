"""Compare recordings that differ in their seeds with others of other seeds, number by number as distributions."""

from collections.abc import Sequence

import numpy as np

from workbench.evaluation.intervals import mean_interval
from workbench.recording.compare.compare import Finding
from workbench.recording.read.reader import Run


def compare_seeds(old: Sequence[Run], new: Sequence[Run], n_judged: int) -> list[Finding]:
    """Tell whether the mean of each of the runs' numbers over `new` lies where the mean over `old` lets one expect it.

    See `workbench.evaluation.intervals.mean_interval`; its level lets all of `n_judged` numbers pass 95 % of the time.
    A number that is missing from any of the runs, or is not finite, fails.
    """
    level = 1.0 - 0.05 / max(n_judged, 1)
    return [_finding(name, old, new, level) for name in sorted({name for run in old for name in run.result})]


def _finding(name: str, old: Sequence[Run], new: Sequence[Run], level: float) -> Finding:
    if lacking := sum(name not in run.result for run in (*old, *new)):
        return Finding(name, None, None, "", False, f"missing from {lacking} of {len(old) + len(new)} runs")
    before, after = (np.array([run.result[name] for run in runs], dtype=np.float64) for runs in (old, new))
    if not (np.isfinite(before).all() and np.isfinite(after).all()):
        return Finding(name, float(before.mean()), float(after.mean()), "", False, "not a finite number in every run")
    allowed = mean_interval(before, after, level)
    passed = bool(abs(after.mean() - before.mean()) <= allowed)
    detail = "" if passed else f"means of {len(old)} and {len(new)} seeds lie too far apart"
    return Finding(name, float(before.mean()), float(after.mean()), f"± {allowed:.3g}", passed, detail)
