"""Groups of runs that differ only in seeds and people: their problems, and statistics of their metrics."""

from collections import Counter
from collections.abc import Iterator, Sequence
from math import isfinite
from typing import Any, NamedTuple

import numpy as np
import pandas as pd

from workbench.evaluation.metrics import HEADLINE, HEADLINE_ERRORS
from workbench.evaluation.uncertainty.intervals import bootstrap_interval
from workbench.recording.read.reader import Run, Unreadable
from workbench.results.report import variation as varied
from workbench.results.report.people import MOTION, half_of, keys_of_people, person_of
from workbench.results.report.variation import EXPERIMENT, Settings, Variation
from workbench.utils.arrays import FloatArray
from workbench.utils.errors import InputError

LEVEL = 0.95
STATUS = {
    "complete": "complete", "failed": "failed", "interrupted": "interrupted", "running": "cut off or still running",
    "stopped": "ended early by sweep.stop_if", "unreadable": "unreadable",
}  # fmt: skip
_STATISTICS = ("n", "people", "mean", "sd_people", "sd", "low_95", "high_95")


class Grouping(NamedTuple):
    """Numbered groups of complete runs with equal settings, in the order of their values.

    labels: a row for each group: `group`, its differences from the others in one line, and the varying keys, as text.
    settings: of each group. runs: a row for each included run, one for each clip and seed of a group. values: a row for
    each finite number of these. statistics: a row for each metric and group: numbers of runs and people, mean and
    standard deviation over the people's means, standard deviation of all runs, and the ends of the interval of the
    mean, over people where there are several, else over runs. counts: recordings by status. problems: a sentence for
    each excluded or missing recording.
    """

    labels: pd.DataFrame
    settings: tuple[Settings, ...]
    runs: pd.DataFrame
    values: pd.DataFrame
    statistics: pd.DataFrame
    variation: Variation
    counts: Counter[str]
    problems: tuple[str, ...]

    @property
    def metrics(self) -> list[str]:
        """The metrics of any run: the headline first, the others alphabetically."""
        return list(self.statistics["metric"].unique())

    @property
    def chief_metrics(self) -> list[str]:
        """The headline metrics, and all metrics of studies only."""
        tracked = [not run.is_study for run in self.runs["run"]]
        of_tracked = self.values["recording"].isin(self.runs["recording"][tracked])
        return [name for name in self.metrics if name in HEADLINE or name not in set(self.values["metric"][of_tracked])]

    @property
    def headline(self) -> str | None:
        """The error that the runs are ranked by; None without one, as in studies."""
        return next((name for name in HEADLINE_ERRORS if name in self.metrics), None)

    def labelled(self, table: pd.DataFrame, keys: bool = False) -> pd.DataFrame:
        """Return a table with labels instead of group numbers; keys: also with the varying keys."""
        labels = self.labels.loc[table["group"], slice(None) if keys else ["group"]]
        return pd.concat([labels.set_index(table.index), table.drop(columns="group")], axis="columns")

    def sample(self, metric: str, group: int) -> pd.DataFrame:
        """Return the rows of `values` of a metric of a group."""
        return self.values[(self.values["metric"] == metric) & (self.values["group"] == group)]


def group_runs(runs: Sequence[Run], unreadable: Sequence[Unreadable] = ()) -> Grouping:
    """Return the runs grouped by the varying keys of their configurations; a run without one is unreadable."""
    reasons = [problem.reason for problem in unreadable]
    rows: list[dict[str, Any]] = []
    for run in runs:
        try:
            settings = varied.flat(run.settings, str(run.provenance.get(EXPERIMENT, "")))
            rows.append({"run": run, "seed": _seed_of(run), "settings": settings})
        except InputError as error:
            reasons.append(str(error))
    of_people = keys_of_people([row["settings"] for row in rows])
    repeated = of_people | varied.seeds_of_parts([row["settings"] for row in rows], [row["seed"] for row in rows])
    for row in rows:
        run, settings = row["run"], row["settings"]
        row |= {"recording": str(run.path), "person": person_of(run.settings), "half": str(half_of(run.settings))}
        row |= {"clip": str(settings.get(MOTION, "")) if of_people else "", "status": run.status, "id": run.id}
        row["settings"] = {key: value for key, value in settings.items() if key not in repeated}
    variation = varied.what_varied([row["settings"] for row in rows])
    order = [tuple(_order(row["settings"], key) for key in variation.keys) for row in rows]
    numbers = {values: k for k, values in enumerate(sorted(set(order)))}
    columns = ["run", "seed", "settings", "recording", "person", "half", "clip", "status", "id"]
    table = pd.DataFrame(rows, columns=columns).assign(group=[numbers[values] for values in order])
    settings_of = tuple(table.drop_duplicates("group").sort_values("group")["settings"])
    newest = table[table["status"] == "complete"].sort_values("id", ascending=False, kind="stable")
    place = ["group", "clip", "seed"]
    counted = newest.drop_duplicates(place).sort_values(place, ignore_index=True)
    labels = [varied.label(variation.keys, each) or str(each[EXPERIMENT]) or "all runs" for each in settings_of]
    problems = [problem for k, label in enumerate(labels) for problem in _problems(table, counted, k, label)]
    problems += [f"not a recording that can be read: {reason}" for reason in reasons]
    keys = {name: [varied.shown(key, each[key]) if key in each else "" for each in settings_of]
            for key, name in varied.short_names(variation.keys).items()}  # fmt: skip
    values = pd.DataFrame(_numbers(counted), columns=["group", "recording", "person", "seed", "metric", "value"])
    counts = Counter(table["status"]) + Counter(unreadable=len(reasons))
    return Grouping(
        pd.DataFrame({"group": labels} | keys, dtype=object), settings_of, counted, values, _statistics(values),
        variation, counts, tuple(problems),
    )  # fmt: skip


def _seed_of(run: Run) -> int:
    seed = run.settings.get("seed")
    if not isinstance(seed, int):
        raise InputError(f"{run.path}: expected a configuration with a whole number as its seed, found {seed!r}")
    return seed


def _order(settings: Settings, key: str) -> tuple[int, float, str, str]:
    """Return a sorting key: numbers by size, then other values alphabetically, then settings without the key."""
    if key not in settings:
        return 2, 0.0, "", ""
    value, exactly = settings[key], varied.comparable(settings, key)
    if isinstance(value, int | float):
        return 0, float(value), "", exactly
    return 1, 0.0, varied.shown(key, value), exactly


def _problems(table: pd.DataFrame, counted: pd.DataFrame, group: int, label: str) -> Iterator[str]:
    """Yield a sentence for each of a group's runs that failed, was cut off, is repeated or is missing."""
    members, ours = table[table["group"] == group], counted[counted["group"] == group]
    complete = set(zip(ours["clip"], ours["seed"], strict=True))
    for row in members[members["status"] != "complete"].itertuples():
        stopped = row.run.properties["run"].get("stopped")
        status = STATUS.get(row.status, row.status) + (f", {stopped}" if stopped else "")
        repeated = "; a complete one exists" if (row.clip, row.seed) in complete else ""
        yield f"{label}, seed {row.seed}: {status}, excluded{repeated} ({row.recording})"
    for row in members[members["status"] == "complete"].itertuples():
        if row.run not in set(ours["run"]):
            yield f"{label}, seed {row.seed}: recorded more than once, excluded ({row.recording})"
    expected = table[table["half"].isin(members["half"])]  # the protocol's other half is not expected
    pairs = [set(zip(each["clip"], each["seed"], strict=True)) for each in (expected, members)]
    missing = sorted(pairs[0] - pairs[1])
    for clip in dict.fromkeys(clip for clip, _ in missing):
        seeds = ", ".join(str(seed) for other, seed in missing if other == clip)
        yield f"{label}: no recording of {f'{clip}, ' * bool(clip)}seed {seeds}, which other groups have"


def _numbers(counted: pd.DataFrame) -> Iterator[tuple[Any, ...]]:
    for row in counted.itertuples():
        for metric, value in sorted({**row.run.result, **row.run.properties.get("cost", {})}.items()):
            if isfinite(value):
                yield row.group, row.recording, row.person, row.seed, metric, float(value)


def _statistics(values: pd.DataFrame) -> pd.DataFrame:
    rows = []
    names = [name for name in HEADLINE if name in set(values["metric"])]
    for metric in [*names, *sorted(set(values["metric"]) - set(names))]:
        for group, sample in values[values["metric"] == metric].groupby("group"):
            people = sample.groupby("person")["value"].mean()
            spread = people.mean(), people.std(), sample["value"].std(), *interval(repetitions(sample))
            rows.append((metric, group, len(sample), len(people), *spread))
    return pd.DataFrame(rows, columns=["metric", "group", *_STATISTICS])


def repetitions(sample: pd.DataFrame) -> FloatArray:
    """Return the sample of an interval: people's means where there are several people, else the runs' values."""
    people = sample.groupby("person", sort=False)["value"].mean()
    return (people if len(people) > 1 else sample["value"]).to_numpy()


def interval(sample: FloatArray) -> FloatArray:
    """Return the confidence interval (2,) of the mean of a sample (n,)."""
    return bootstrap_interval(sample, np.random.default_rng(0), LEVEL)
