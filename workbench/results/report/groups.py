"""Runs that differ in nothing but their seed and whom they show, grouped: what is wrong, and what metrics come to."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from workbench.evaluation.headline import ERRORS, TITLES
from workbench.evaluation.intervals import bootstrap_interval
from workbench.recording.read.reader import Run, Unreadable
from workbench.results.report import variation as varied
from workbench.results.report.people import MOTION, keys_of_people, person_of
from workbench.results.report.protocol import half_of
from workbench.results.report.variation import EXPERIMENT, Settings, Variation
from workbench.utils.arrays import FloatArray
from workbench.utils.errors import InputError

LEVEL = 0.95

STATUS = {
    "failed": "failed",
    "interrupted": "interrupted",
    "running": "cut off or still running",
    "stopped": "ended early by sweep.stop_when",
}


@dataclass(frozen=True, eq=False)
class Group:
    """Runs with equal settings. label: how they differ from the other groups'.

    values: of the keys that varied, as far as it has them. settings: all of them. runs: those complete, by clip and
    seed, one each. incomplete: the others. repeats: complete ones of what is there already, left out. missing: clips
    and seeds that other groups have; clips are empty where they do not repeat, see `keys_of_people`.
    """

    label: str
    values: Settings
    settings: Settings
    runs: tuple[Run, ...]
    incomplete: tuple[Run, ...] = ()
    repeats: tuple[Run, ...] = ()
    missing: tuple[tuple[str, int], ...] = ()


@dataclass(frozen=True, eq=False)
class Grouping:
    """All groups, in the order of their values, and the recordings that could not be read."""

    groups: tuple[Group, ...]
    variation: Variation
    unreadable: tuple[Unreadable, ...] = ()

    @property
    def runs(self) -> tuple[Run, ...]:
        """Select those complete, group by group."""
        return tuple(run for group in self.groups for run in group.runs)

    @property
    def problems(self) -> tuple[str, ...]:
        """Tell what is wrong, a sentence each: failed, cut off, repeated, missing and unreadable runs."""
        found = []
        for group in self.groups:
            for run in group.incomplete:
                again = "; a complete one is there" if _same(run, group.runs) else ""
                status = STATUS.get(run.status, run.status)
                if condition := run.properties["run"].get("stopped"):
                    status = f"{status}, {condition}"
                found.append(f"{group.label}, seed {seed_of(run)}: {status}, not counted{again} ({run.path})")
            found += [
                f"{group.label}, seed {seed_of(run)}: recorded more than once, not counted again ({run.path})"
                for run in group.repeats
            ]
            for clip in dict.fromkeys(clip for clip, _ in group.missing):
                seeds = ", ".join(str(seed) for other, seed in group.missing if other == clip)
                what = f"{clip}, seed {seeds}" if clip else f"seed {seeds}"
                found.append(f"{group.label}: no recording of {what}, which other groups have")
        return (*found, *(f"not a recording that can be read: {problem.reason}" for problem in self.unreadable))


def _same(run: Run, others: Sequence[Run]) -> bool:
    """Tell whether one of the others shows the same clip with the same seed."""
    shown = [(str((each.settings.get("dataset") or {}).get("motion", "")), seed_of(each)) for each in (run, *others)]
    return shown[0] in shown[1:]


def seed_of(run: Run) -> int:
    """Return the run's seed; raises InputError when its configuration has none."""
    seed = run.settings.get("seed")
    if not isinstance(seed, int):
        raise InputError(f"{run.path}: expected a configuration with a whole number as its seed, found {seed!r}")
    return seed


def group_runs(runs: Sequence[Run], unreadable: Sequence[Unreadable] = ()) -> Grouping:
    """Group the runs by what varied in their configurations; one without a readable one joins the unreadable."""
    readable: list[tuple[Run, dict[str, Any]]] = []
    problems = list(unreadable)
    for run in runs:
        try:
            seed_of(run)
            readable.append((run, varied.flat(run.settings, str(run.provenance.get(EXPERIMENT, "")))))
        except InputError as error:
            problems.append(Unreadable(Path(run.path), str(error)))
    rows = [settings for _, settings in readable]
    of_people = keys_of_people(rows)
    repeated = of_people | varied.seeds_of_parts(rows, [seed_of(run) for run, _ in readable])
    told = {run: (str(row.get(MOTION, "")) if of_people else "", seed_of(run)) for run, row in readable}
    readable = [(run, {k: v for k, v in settings.items() if k not in repeated}) for run, settings in readable]
    variation = varied.what_varied([settings for _, settings in readable])
    members: dict[tuple[str, ...], list[tuple[Run, dict[str, Any]]]] = {}
    for run, settings in readable:
        values = tuple(varied.comparable(settings, key) for key in variation.keys)
        members.setdefault(values, []).append((run, settings))
    groups = [_group([run for run, _ in found], found[0][1], variation, told) for found in members.values()]
    groups.sort(key=lambda group: [_rank(group, key) for key in variation.keys])
    return Grouping(tuple(groups), variation, tuple(problems))


def _group(runs: Sequence[Run], settings: Settings, variation: Variation, told: Mapping[Run, tuple[str, int]]) -> Group:
    """Group runs; told: clip and seed of every run of all groups. Of a protocol's other half none is missing."""
    halves = {half_of(run.settings) for run in runs}
    expected = {shown for run, shown in told.items() if half_of(run.settings) in halves}
    complete: dict[tuple[str, int], Run] = {}
    repeats: list[Run] = []
    for run in sorted(runs, key=lambda run: run.id, reverse=True):
        if run.status == "complete" and complete.setdefault(told[run], run) is not run:
            repeats.append(run)
    return Group(
        label=varied.label(variation.keys, settings) or str(settings[EXPERIMENT]) or "all runs",
        values={key: settings[key] for key in variation.keys if key in settings},
        settings=settings,
        runs=tuple(complete[each] for each in sorted(complete)),
        incomplete=tuple(run for run in runs if run.status != "complete"),
        repeats=tuple(repeats),
        missing=tuple(sorted(expected - {told[run] for run in runs})),
    )


def _rank(group: Group, key: str) -> tuple[int, float, str]:
    """Numbers by size, then text by the alphabet, then groups without the key."""
    if key not in group.values:
        return 2, 0.0, ""
    value = group.values[key]
    return (0, float(value), "") if isinstance(value, int | float) else (1, 0.0, varied.shown(key, value))


@dataclass(frozen=True)
class Statistic:
    """A metric over a group's runs. n: those with a finite value. people: whom they show, each with a mean of its own.

    mean: over the people's means, sd_people their standard deviation. sd: of all runs. low, high: of the interval of
    the mean, over people where there are several, else over runs. NaN where there are fewer than two of them.
    """

    metric: str
    n: int
    people: int
    mean: float
    sd_people: float
    sd: float
    low: float
    high: float


def numbers(run: Run) -> dict[str, float]:
    """Return a complete run's metrics and its cost, by name."""
    return {**run.result, **run.properties.get("cost", {})}


def metric_names(groups: Sequence[Group]) -> list[str]:
    """Name the metrics that any of the runs has: the chief ones first, the others by the alphabet."""
    found = {name for group in groups for run in group.runs for name in numbers(run)}
    return [name for name in TITLES if name in found] + sorted(found - TITLES.keys())


def chief_names(groups: Sequence[Group]) -> list[str]:
    """Name the chief metrics, and all of those that only studies have."""
    tracked = {name for group in groups for run in group.runs if not run.is_study for name in numbers(run)}
    return [name for name in metric_names(groups) if name in TITLES or name not in tracked]


def headline(groups: Sequence[Group]) -> str | None:
    """Name the error that the runs are ranked by; None where there is none, as in studies."""
    found = metric_names(groups)
    return next((name for name in ERRORS if name in found), None)


def values(group: Group, metric: str) -> list[tuple[Run, float]]:
    """Return the group's runs with their value of a metric, where it is finite."""
    found = [(run, float(numbers(run).get(metric, np.nan))) for run in group.runs]
    return [(run, value) for run, value in found if np.isfinite(value)]


def statistic(group: Group, metric: str) -> Statistic | None:
    """Sum up the metric over the group's runs; None when no run has it.

    The resampling has a generator of its own, so that a group's interval does not depend on the other groups.
    """
    found = values(group, metric)
    if not found:
        return None
    sample, people = np.array([value for _, value in found]), by_person(found)
    low, high = interval(repetitions(found))
    return Statistic(
        metric, len(sample), len(people), float(people.mean()), _sd(people), _sd(sample), float(low), float(high)
    )


def by_person(found: Sequence[tuple[Run, float]]) -> FloatArray:
    """Average what was found over the runs that show the same person; one number each."""
    people: dict[str, list[float]] = {}
    for run, value in found:
        people.setdefault(person_of(run.settings), []).append(value)
    return np.array([np.mean(each) for each in people.values()])


def repetitions(found: Sequence[tuple[Run, float]]) -> FloatArray:
    """Return what an interval is over: people's means where there are several people, else the single runs'."""
    people = by_person(found)
    return people if len(people) > 1 else np.array([value for _, value in found])


def _sd(sample: FloatArray) -> float:
    return float(sample.std(ddof=1)) if len(sample) > 1 else float("nan")


def interval(sample: FloatArray) -> FloatArray:
    """Return the interval (2, ...) of the mean of a sample (n, ...)."""
    return bootstrap_interval(sample, np.random.default_rng(0), LEVEL)


def joint_errors(run: Run) -> Mapping[str, float]:
    """Return every joint's mean distance from its true place, mm, over the frames after the first that have truth.

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
