"""Runs that differ in nothing but their seed and whom they show, grouped: what is wrong, and statistics of metrics."""

from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
import pandas as pd

from workbench.evaluation.headline import ERRORS, TITLES
from workbench.evaluation.intervals import bootstrap_interval
from workbench.recording.read.reader import Run, Unreadable
from workbench.results.report.people import MOTION, half_of, keys_of_people, person_of
from workbench.results.report.variation import (
    EXPERIMENT,
    Settings,
    Variation,
    comparable,
    flat,
    label,
    seeds_of_parts,
    shown,
    what_varied,
)
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
    """Complete runs with equal settings, one for each clip and seed.

    label: how they differ from the other groups'. values: of the keys that varied, as far as it has them. settings:
    all of them. numbers: a row for each run, a column for each metric and cost, NaN where a run has no finite number;
    the index is (recording, person, seed).
    """

    label: str
    values: Settings
    settings: Settings
    runs: tuple[Run, ...]
    numbers: pd.DataFrame


class Grouping(NamedTuple):
    """All groups, in the order of their values. counts: recordings by status. problems: a sentence for each recording
    that does not count or is missing."""

    groups: tuple[Group, ...]
    variation: Variation
    counts: Counter[str]
    problems: tuple[str, ...]


def seed_of(run: Run) -> int:
    """Return the run's seed; raises InputError when its configuration has none."""
    seed = run.settings.get("seed")
    if not isinstance(seed, int):
        raise InputError(f"{run.path}: expected a configuration with a whole number as its seed, found {seed!r}")
    return seed


def group_runs(runs: Sequence[Run], unreadable: Sequence[Unreadable] = ()) -> Grouping:
    """Group the runs by what varied in their configurations; one without a readable one joins the unreadable."""
    reasons = [problem.reason for problem in unreadable]
    rows: list[dict[str, Any]] = []
    for run in runs:
        try:
            settings = flat(run.settings, str(run.provenance.get(EXPERIMENT, "")))
            rows.append({"run": run, "seed": seed_of(run), "half": str(half_of(run.settings)), "settings": settings})
        except InputError as error:
            reasons.append(str(error))
    of_people = keys_of_people([row["settings"] for row in rows])
    repeated = of_people | seeds_of_parts([row["settings"] for row in rows], [row["seed"] for row in rows])
    for row in rows:
        row["clip"] = str(row["settings"].get(MOTION, "")) if of_people else ""
        row["settings"] = {key: value for key, value in row["settings"].items() if key not in repeated}
    variation = what_varied([row["settings"] for row in rows])
    members: dict[tuple[str, ...], list[dict[str, Any]]] = {}
    for row in rows:
        members.setdefault(tuple(comparable(row["settings"], key) for key in variation.keys), []).append(row)
    found = [_group(each, rows, variation) for each in members.values()]
    found.sort(key=lambda pair: [_rank(pair[0], key) for key in variation.keys])
    counts = Counter(row["run"].status for row in rows) + Counter(unreadable=len(reasons))
    problems = [problem for _, problems in found for problem in problems]
    problems += [f"not a recording that can be read: {reason}" for reason in reasons]
    return Grouping(tuple(group for group, _ in found), variation, counts, tuple(problems))


def _group(
    members: Sequence[dict[str, Any]], rows: Sequence[dict[str, Any]], variation: Variation
) -> tuple[Group, list[str]]:
    """Return a group and its problems. rows: of all groups, which tell the clips and seeds that should be there."""
    settings = members[0]["settings"]
    name = label(variation.keys, settings) or str(settings[EXPERIMENT]) or "all runs"
    table = pd.DataFrame(members)
    complete = table[[run.status == "complete" for run in table["run"]]]
    newest = complete.iloc[np.argsort([run.id for run in complete["run"]], kind="stable")[::-1]]
    counted = newest.drop_duplicates(["clip", "seed"]).sort_values(["clip", "seed"])
    runs = tuple(counted["run"])
    persons = [person_of(run.settings) for run in runs]
    index = pd.MultiIndex.from_arrays(
        [[str(run.path) for run in runs], persons, counted["seed"]], names=["recording", "person", "seed"]
    )
    numbers = pd.DataFrame([{**run.result, **run.properties.get("cost", {})} for run in runs], index, dtype=float)
    values = {key: settings[key] for key in variation.keys if key in settings}
    group = Group(name, values, settings, runs, numbers.where(np.isfinite(numbers)))
    halves = set(table["half"])  # of a protocol's other half no run is missing
    expected = {(row["clip"], row["seed"]) for row in rows if row["half"] in halves}
    return group, list(_problems(name, table, counted, expected))


def _problems(name: str, table: pd.DataFrame, counted: pd.DataFrame, expected: set[tuple[str, int]]) -> Iterator[str]:
    """Describe a group's runs that failed, were cut off, are repeated or missing, a sentence each."""
    there = set(zip(counted["clip"], counted["seed"], strict=True))
    for run, clip, seed in zip(table["run"], table["clip"], table["seed"], strict=True):
        if run.status != "complete":
            status = ", ".join(filter(None, (STATUS.get(run.status, run.status), run.properties["run"].get("stopped"))))
            again = "; a complete one is there" if (clip, seed) in there else ""
            yield f"{name}, seed {seed}: {status}, not counted{again} ({run.path})"
    for run, seed in zip(table["run"], table["seed"], strict=True):
        if run.status == "complete" and run not in set(counted["run"]):
            yield f"{name}, seed {seed}: recorded more than once, not counted again ({run.path})"
    missing = sorted(expected - set(zip(table["clip"], table["seed"], strict=True)))
    for clip in dict.fromkeys(clip for clip, _ in missing):
        seeds = ", ".join(str(seed) for other, seed in missing if other == clip)
        yield f"{name}: no recording of {f'{clip}, ' * bool(clip)}seed {seeds}, which other groups have"


def _rank(group: Group, key: str) -> tuple[int, float, str]:
    """Order numbers by size, then text by the alphabet, then groups without the key."""
    if key not in group.values:
        return 2, 0.0, ""
    value = group.values[key]
    return (0, float(value), "") if isinstance(value, int | float) else (1, 0.0, shown(key, value))


def metric_names(groups: Sequence[Group]) -> list[str]:
    """Return the names of the metrics that any of the runs has: those of TITLES first, the others by the alphabet."""
    found = {name for group in groups for name in group.numbers}
    return [name for name in TITLES if name in found] + sorted(found - TITLES.keys())


def chief_names(groups: Sequence[Group]) -> list[str]:
    """Return the metrics of TITLES, and all of those that only studies have."""
    tracked = {name for group in groups if not all(run.is_study for run in group.runs) for name in group.numbers}
    return [name for name in metric_names(groups) if name in TITLES or name not in tracked]


def headline(groups: Sequence[Group]) -> str | None:
    """Return the name of the error that the runs are ranked by; None where there is none, as in studies."""
    return next((name for name in ERRORS if name in metric_names(groups)), None)


class Statistic(NamedTuple):
    """A metric over a group's runs. n: runs with a finite value. people: whom they show.

    mean: over the people's means, sd_people their standard deviation. sd: of all runs. low, high: interval of the mean,
    over people where there are several, else over runs. NaN where there are fewer than two of them.
    """

    n: int
    people: int
    mean: float
    sd_people: float
    sd: float
    low: float
    high: float


def values(group: Group, metric: str) -> "pd.Series[float]":
    """Return the finite values of a metric, indexed by recording, person and seed."""
    return group.numbers.get(metric, pd.Series(index=group.numbers.index, dtype=float)).dropna()


def statistic(group: Group, metric: str) -> Statistic | None:
    """Summarise the metric over the group's runs; None when no run has it."""
    sample = values(group, metric)
    if sample.empty:
        return None
    people = sample.groupby(level="person").mean()
    spread = people.mean(), people.std(), sample.std(), *interval(repetitions(sample))
    return Statistic(len(sample), len(people), *map(float, spread))


def repetitions(sample: "pd.Series[float]") -> FloatArray:
    """Return what an interval is over: people's means where there are several people, else the single runs."""
    people = sample.groupby(level="person", sort=False).mean()
    return (people if len(people) > 1 else sample).to_numpy()


def interval(sample: FloatArray) -> FloatArray:
    """Return the interval (2, ...) of the mean of a sample (n, ...), which does not depend on other groups."""
    return bootstrap_interval(sample, np.random.default_rng(0), LEVEL)
