"""Mean, standard deviation and bootstrap interval of every metric of every group."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from workbench.arrays import FloatArray
from workbench.evaluation.intervals import bootstrap_interval
from workbench.recording.read.reader import Run
from workbench.report.groups import Group

LEVEL = 0.95

CHIEF: dict[str, str] = {
    "error_abs_mm": "mean joint error (mm)",
    "error_rel_mm": "mean joint error, pelvis on pelvis (mm)",
    "error_px": "mean error in the image (px)",
    "held": "held throughout (fraction of runs)",
    "coverage_90": "coverage of the 90 % band (fraction)",
    "activity_accuracy": "activity told right (fraction)",
    "seconds": "time taken (s)",
    "likelihood_evaluations": "likelihood evaluations",
}
"""The metrics that a person asks for first, with what they are and their units."""
HEADLINES = ("error_abs_mm", "error_px")
"""What runs are ranked by: the first that any of them has; less is better."""


@dataclass(frozen=True)
class Statistic:
    """A metric over a group's runs. n: those with a finite value. sd: of the sample. low, high: of the interval.

    sd, low and high are NaN for fewer than two runs.
    """

    metric: str
    n: int
    mean: float
    sd: float
    low: float
    high: float


def numbers(run: Run) -> dict[str, float]:
    """A complete run's metrics and its cost, by name."""
    return {**run.result, **run.properties.get("cost", {})}


def metric_names(groups: Sequence[Group]) -> list[str]:
    """The metrics that any of the runs has: the chief ones first, the others by the alphabet."""
    found = {name for group in groups for run in group.runs for name in numbers(run)}
    return [name for name in CHIEF if name in found] + sorted(found - CHIEF.keys())


def chief_names(groups: Sequence[Group]) -> list[str]:
    """The chief metrics, and all of those that only studies have."""
    tracked = {name for group in groups for run in group.runs if not run.is_study for name in numbers(run)}
    return [name for name in metric_names(groups) if name in CHIEF or name not in tracked]


def headline(groups: Sequence[Group]) -> str | None:
    """The error that the runs are ranked by; None where there is none, as in studies."""
    found = metric_names(groups)
    return next((name for name in HEADLINES if name in found), None)


def values(group: Group, metric: str) -> list[tuple[Run, float]]:
    """The group's runs with their value of a metric, where it is finite."""
    found = [(run, float(numbers(run).get(metric, np.nan))) for run in group.runs]
    return [(run, value) for run, value in found if np.isfinite(value)]


def statistic(group: Group, metric: str) -> Statistic | None:
    """The metric over the group's runs; None when no run has it.

    The resampling has a generator of its own, so that a group's interval does not depend on the other groups.
    """
    sample = np.array([value for _, value in values(group, metric)])
    if not len(sample):
        return None
    low, high = interval(sample)
    sd = float(sample.std(ddof=1)) if len(sample) > 1 else float("nan")
    return Statistic(metric, len(sample), float(sample.mean()), sd, float(low), float(high))


def interval(sample: FloatArray) -> FloatArray:
    """The interval (2, ...) of the mean of a sample (n, ...)."""
    return bootstrap_interval(sample, np.random.default_rng(0), LEVEL)


def joint_errors(run: Run) -> Mapping[str, float]:
    """Mean distance of every joint from its true place, mm, over the frames after the first that have a true one.

    Empty for studies and without truth. The first frame is given, not tracked.
    """
    if run.is_study:
        return {}
    estimate, truth = run.joints, run.true_joints
    frames, mine, true = np.intersect1d(estimate.frames, truth.frames, return_indices=True)
    tracked = frames > estimate.frames.min(initial=np.iinfo(np.int64).max)
    if not tracked.any():
        return {}
    apart = estimate.positions[mine[tracked]] - truth.positions[true[tracked]]
    means = 1e3 * np.linalg.norm(apart, axis=2).mean(axis=0)
    return {name: float(value) for name, value in zip(estimate.names, means, strict=True)}
