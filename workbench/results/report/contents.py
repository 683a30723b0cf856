"""Contents of a report: the sentences and tables of the terminal, Markdown and HTML."""

from collections import Counter
from typing import NamedTuple

import pandas as pd

from workbench.evaluation.metrics import HEADLINE, row_of
from workbench.evaluation.uncertainty.intervals import N_RESAMPLES
from workbench.results.formatting import table_of
from workbench.results.report.groups import LEVEL, STATUS, Grouping
from workbench.results.report.people import half_of
from workbench.results.report.protocol import divided
from workbench.results.report.variation import short_names

_MAX_FOLLOWING = 6
_HEADER = {"sd_people": "sd of people", "sd": "sd of runs", "low_95": "95% low", "high_95": "95% high"}


class Contents(NamedTuple):
    """Contents of a report.

    summary: sentences about the recordings. problems: a sentence for each excluded run. tables: by title, of the chief
    metrics, of a protocol's runs, of verdicts, and of best and worst runs. others: of the other metrics.
    """

    summary: tuple[str, ...]
    problems: tuple[str, ...]
    tables: dict[str, pd.DataFrame]
    others: dict[str, pd.DataFrame]


def contents(grouping: Grouping) -> Contents:
    """Return the sentences and tables about the groups."""
    by_metric = {name: grouping.labelled(rows).drop(columns="metric").rename(columns=_HEADER)
                 for name, rows in grouping.statistics.groupby("metric", sort=False)}  # fmt: skip
    chief = grouping.chief_metrics
    tables = {f"{name}: {row_of(name).heading}" if name in HEADLINE else name: by_metric[name] for name in chief}
    tables |= divided(grouping) | _verdicts(grouping) | _extremes(grouping)
    others = {name: table for name, table in by_metric.items() if name not in chief}
    return Contents(tuple(_summary(grouping)), grouping.problems, tables, others)


def _summary(grouping: Grouping) -> list[str]:
    counts, n_groups, runs = grouping.counts, len(grouping.settings), grouping.runs["run"]
    listed = ", ".join(f"{counts[status]} {words}" for status, words in STATUS.items() if counts[status])
    sentences = [f"{counts.total()} recordings: {listed}."]
    n_people = grouping.runs["person"].nunique()
    repeated = "repeated over seeds" + (f" and {n_people} people" if n_people > 1 else "")
    if grouping.variation.keys:
        names = ", ".join(short_names(grouping.variation.keys).values())
        sentences.append(f"{n_groups} groups by {names}, {repeated}.")
    elif n_groups:
        sentences.append(f"One group, {grouping.labels['group'][0]}, {repeated}.")
    if following := grouping.variation.following:
        more = f" and {len(following) - _MAX_FOLLOWING} more" if len(following) > _MAX_FOLLOWING else ""
        sentences.append(f"They also change: {', '.join(following[:_MAX_FOLLOWING])}{more}.")
    if halves := sorted({half for run in runs if (half := half_of(run.settings)) is not None}):
        sentences.append(f"They are of these splits of the protocol's clips: {', '.join(halves)}.")
    versions = sorted({str(run.provenance.get("workbench", "unknown")) for run in runs})
    if len(versions) > 1:
        sentences.append(f"The runs are of different versions of the workbench: {', '.join(versions)}.")
    if grouping.headline is not None and "seconds" not in grouping.metrics:
        sentences.append("The recordings have no run times.")
    sentences.append(
        f"Means are over people, each with the mean of their runs. Intervals are {LEVEL:.0%} percentile bootstrap "
        f"intervals over people, or over seeds where there is one person ({N_RESAMPLES} resamples); with a handful of "
        "either they are too narrow."
    )
    return sentences


def _verdicts(grouping: Grouping) -> dict[str, pd.DataFrame]:
    """Return counts of the verdicts of every group's runs, each with an example; {} without verdicts."""
    rows = []
    for group, runs in grouping.runs.groupby("group")["run"]:
        verdicts = [each for run in runs if "level" in (each := run.properties.get("verdict") or {})]
        for level, n in Counter(str(each["level"]) for each in verdicts).most_common():
            example = next(str(each["message"]) for each in verdicts if each["level"] == level)
            rows.append((grouping.labels["group"][group], level, n, example))
    return {"verdicts": table_of(("group", "verdict", "runs", "example"), rows)} if rows else {}


def _extremes(grouping: Grouping) -> dict[str, pd.DataFrame]:
    if (metric := grouping.headline) is None:
        return {}
    ranked = grouping.values[grouping.values["metric"] == metric].sort_values(["group", "value"], kind="stable")
    best, worst = (ranked.drop_duplicates("group", keep=keep) for keep in ("first", "last"))
    ends = pd.concat([best.assign(run="best"), worst.assign(run="worst")]).sort_values("group", kind="stable")
    table = grouping.labelled(ends).rename(columns={"value": metric})
    columns = ["group", "run", metric, "person", "seed", "recording"]
    return {f"best and worst runs by {metric}": table[columns]}
