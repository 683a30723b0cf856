"""What a report says: the sentences and tables that the terminal, Markdown and the page all show."""

from collections import Counter
from collections.abc import Sequence
from typing import NamedTuple

import pandas as pd

from workbench.evaluation.headline import TITLES
from workbench.evaluation.intervals import N_RESAMPLES
from workbench.results.formatting import table_of
from workbench.results.report.groups import (
    LEVEL,
    STATUS,
    Group,
    Grouping,
    Statistic,
    chief_names,
    headline,
    metric_names,
    statistic,
    values,
)
from workbench.results.report.people import half_of, person_of
from workbench.results.report.protocol import divided
from workbench.results.report.variation import short_names, shown

_MOST_FOLLOWING = 6
_STATISTICS = ("n", "people", "mean", "sd of people", "sd of runs", f"{LEVEL:.0%} low", f"{LEVEL:.0%} high")


class Contents(NamedTuple):
    """summary: sentences about what was read. problems: a sentence for each run that does not count.

    tables: by title, of the chief metrics, of a protocol's runs, of verdicts, and of best and worst runs. others: of
    the other metrics.
    """

    summary: tuple[str, ...]
    problems: tuple[str, ...]
    tables: dict[str, pd.DataFrame]
    others: dict[str, pd.DataFrame]


def contents(grouping: Grouping) -> Contents:
    """Collect the sentences and tables about the groups."""
    groups = grouping.groups
    chief = chief_names(groups)
    tables = {f"{name}: {TITLES[name]}" if name in TITLES else name: _metric_table(groups, name) for name in chief}
    tables |= divided(groups) | _verdicts(groups) | _extremes(groups)
    others = {name: _metric_table(groups, name) for name in metric_names(groups) if name not in chief}
    return Contents(tuple(_summary(grouping)), grouping.problems, tables, others)


def _summary(grouping: Grouping) -> list[str]:
    groups, counts = grouping.groups, grouping.counts
    runs = [run for group in groups for run in group.runs]
    words = {"complete": "complete", **STATUS, "unreadable": "unreadable"}
    listed = ", ".join(f"{counts[status]} {word}" for status, word in words.items() if counts[status])
    sentences = [f"{counts.total()} recordings: {listed}."]
    people = {person_of(run.settings) for run in runs}
    repeated = "repeated over seeds" + (f" and {len(people)} people" if len(people) > 1 else "")
    if grouping.variation.keys:
        names = short_names(grouping.variation.keys)
        sentences.append(f"{len(groups)} groups by {', '.join(names.values())}, {repeated}.")
    elif groups:
        sentences.append(f"One group, {groups[0].label}, {repeated}.")
    if following := grouping.variation.following:
        more = f" and {len(following) - _MOST_FOLLOWING} more" if len(following) > _MOST_FOLLOWING else ""
        sentences.append(f"With them change: {', '.join(following[:_MOST_FOLLOWING])}{more}.")
    if halves := sorted({str(half_of(run.settings)) for run in runs} - {"None"}):
        sentences.append(f"They are of these halves of the protocol's clips: {', '.join(halves)}.")
    versions = sorted({str(run.provenance.get("workbench", "unknown")) for run in runs})
    if len(versions) > 1:
        sentences.append(f"The runs are of different versions of the workbench: {', '.join(versions)}.")
    if headline(groups) is not None and "seconds" not in metric_names(groups):
        sentences.append("The recordings do not say what the runs took.")
    sentences.append(
        f"Means are over people, each with the mean of their runs. Intervals are {LEVEL:.0%} percentile bootstrap "
        f"intervals over people, or over seeds where there is one person ({N_RESAMPLES} resamples); with a handful of "
        "either they are too narrow."
    )
    return sentences


def _metric_table(groups: Sequence[Group], metric: str) -> pd.DataFrame:
    rows = [(group.label, *found) for group in groups if (found := statistic(group, metric)) is not None]
    return table_of(("group", *_STATISTICS), rows)


def _verdicts(groups: Sequence[Group]) -> dict[str, pd.DataFrame]:
    """Count the verdicts of every group's runs, with the sentence of the first of each; nothing where there is none."""
    rows = []
    for group in groups:
        verdicts = [each for run in group.runs if "kind" in (each := run.properties.get("verdict") or {})]
        for kind, n in Counter(str(each["kind"]) for each in verdicts).most_common():
            example = next(str(each["sentence"]) for each in verdicts if each["kind"] == kind)
            rows.append((group.label, kind, n, example))
    return {"verdicts": table_of(("group", "verdict", "runs", "such as"), rows)} if rows else {}


def _extremes(groups: Sequence[Group]) -> dict[str, pd.DataFrame]:
    if (metric := headline(groups)) is None:
        return {}
    rows = []
    for group in groups:
        if not (sample := values(group, metric)).empty:
            for name, place in (("best", sample.idxmin()), ("worst", sample.idxmax())):
                recording, person, seed = place
                rows.append((group.label, name, sample[place], person, seed, recording))
    return {f"best and worst runs by {metric}": table_of(("group", "run", metric, "person", "seed", "recording"), rows)}


def group_csv(grouping: Grouping) -> str:
    """Return CSV with a row for each group and metric: the keys that varied, and the statistics."""
    keys = grouping.variation.keys
    header = ("group", *short_names(keys).values(), "metric", *Statistic._fields[:-2], "low_95", "high_95")
    rows = [
        (group.label, *_cells(group, keys), metric, *found)
        for metric in metric_names(grouping.groups)
        for group in grouping.groups
        if (found := statistic(group, metric)) is not None
    ]
    return table_of(header, rows).to_csv(index=False)


def run_csv(grouping: Grouping) -> str:
    """Return CSV with a row for each complete run and metric."""
    keys = grouping.variation.keys
    header = ("recording", "group", *short_names(keys).values(), "person", "seed", "metric", "value")
    rows = [
        (recording, group.label, *_cells(group, keys), person, seed, metric, value)
        for group in grouping.groups
        for (recording, person, seed), numbers in group.numbers.sort_index(axis="columns").iterrows()
        for metric, value in numbers.dropna().items()
    ]
    return table_of(header, rows).to_csv(index=False)


def _cells(group: Group, keys: Sequence[str]) -> list[str]:
    return [shown(key, group.values[key]) if key in group.values else "" for key in keys]
