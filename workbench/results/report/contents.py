"""What a report says: the sentences and tables that the terminal, Markdown and the page all show."""

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass

from workbench.evaluation.headline import TITLES
from workbench.evaluation.intervals import N_RESAMPLES
from workbench.results.report import groups as runs
from workbench.results.report.groups import LEVEL, STATUS, Group, Grouping, Statistic, headline, metric_names, statistic
from workbench.results.report.people import person_of
from workbench.results.report.protocol import divided, half_of
from workbench.results.report.tables import Table, comma_separated, number
from workbench.results.report.variation import short_names, shown

_MOST_FOLLOWING = 6
_COLUMNS = ("group", "n", "people", "mean", "sd of people", "sd of runs", f"{LEVEL:.0%} interval")


@dataclass(frozen=True, eq=False)
class Contents:
    """summary: sentences about what was read. problems: a sentence for each run that does not count.

    verdicts: what the runs of every group came to. extremes: every group's best and worst run. divided: tables of a
    protocol's runs. chief, others: tables by metric, what everybody asks for and the rest.
    """

    summary: tuple[str, ...]
    problems: tuple[str, ...]
    verdicts: tuple[str, Table] | None
    extremes: tuple[str, Table] | None
    divided: tuple[tuple[str, Table], ...]
    chief: tuple[tuple[str, Table], ...]
    others: tuple[tuple[str, Table], ...]


def contents(grouping: Grouping) -> Contents:
    """Collect all that is to be said about the groups."""
    chief = runs.chief_names(grouping.groups)
    others = [name for name in metric_names(grouping.groups) if name not in chief]
    return Contents(
        summary=_summary(grouping),
        problems=grouping.problems,
        verdicts=_verdicts(grouping.groups),
        extremes=_extremes(grouping.groups),
        divided=tuple(divided({group.label: group.runs for group in grouping.groups})),
        chief=tuple(_metric_table(grouping.groups, name) for name in chief),
        others=tuple(_metric_table(grouping.groups, name) for name in others),
    )


def _summary(grouping: Grouping) -> tuple[str, ...]:
    groups = grouping.groups
    ended = Counter(run.status for group in groups for run in group.incomplete)
    counted = {
        "complete": sum(len(group.runs) + len(group.repeats) for group in groups),
        **{words: ended[status] for status, words in STATUS.items()},
        "unreadable": len(grouping.unreadable),
    }
    listed = ", ".join(f"{n} {status}" for status, n in counted.items() if n)
    said = [f"{sum(counted.values())} recordings: {listed}."]
    if grouping.variation.keys:
        names = short_names(grouping.variation.keys)
        said.append(f"{len(groups)} groups by {', '.join(names.values())}, repeated over seeds{_and_people(groups)}.")
    elif groups:
        said.append(f"One group, {groups[0].label}, repeated over seeds{_and_people(groups)}.")
    if following := grouping.variation.following:
        more = f" and {len(following) - _MOST_FOLLOWING} more" if len(following) > _MOST_FOLLOWING else ""
        said.append(f"With them change: {', '.join(following[:_MOST_FOLLOWING])}{more}.")
    if halves := sorted({str(half_of(run.settings)) for run in grouping.runs} - {"None"}):
        said.append(f"They are of these halves of the protocol's clips: {', '.join(halves)}.")
    versions = sorted({str(run.provenance.get("workbench", "unknown")) for run in grouping.runs})
    if len(versions) > 1:
        said.append(f"The runs are of different versions of the workbench: {', '.join(versions)}.")
    if headline(groups) is not None and "seconds" not in metric_names(groups):
        said.append("The recordings do not say what the runs took.")
    said.append(
        f"Means are over people, each with the mean of their runs. Intervals are {LEVEL:.0%} percentile bootstrap "
        f"intervals over people, or over seeds where there is one person ({N_RESAMPLES} resamples); with a handful of "
        "either they are too narrow."
    )
    return tuple(said)


def _and_people(groups: Sequence[Group]) -> str:
    people = {person_of(run.settings) for group in groups for run in group.runs}
    return f" and {len(people)} people" if len(people) > 1 else ""


def _metric_table(groups: Sequence[Group], metric: str) -> tuple[str, Table]:
    rows = []
    for group in groups:
        if (each := statistic(group, metric)) is not None:
            interval = "–" if each.n < 2 else f"{number(each.low)} to {number(each.high)}"
            spread = number(each.sd_people), number(each.sd)
            rows.append((group.label, str(each.n), str(each.people), number(each.mean), *spread, interval))
    title = f"{metric}: {TITLES[metric]}" if metric in TITLES else metric
    return title, Table(_COLUMNS, tuple(rows), frozenset(_COLUMNS[1:]))


def _verdicts(groups: Sequence[Group]) -> tuple[str, Table] | None:
    """Count the verdicts of every group's runs, with the sentence of the first of each; None where no run has one."""
    rows = []
    for group in groups:
        told = [run.properties.get("verdict") or {} for run in group.runs]
        kinds = Counter(str(each["kind"]) for each in told if "kind" in each)
        for kind, n in kinds.most_common():
            example = next(str(each["sentence"]) for each in told if each.get("kind") == kind)
            rows.append((group.label, kind, str(n), example))
    header = ("group", "verdict", "runs", "such as")
    return ("verdicts", Table(header, tuple(rows), frozenset(("runs",)))) if rows else None


def _extremes(groups: Sequence[Group]) -> tuple[str, Table] | None:
    metric = headline(groups)
    if metric is None:
        return None
    rows = []
    for group in groups:
        ranked = sorted(runs.values(group, metric), key=lambda pair: pair[1])
        for name, (run, value) in zip(("best", "worst"), (ranked[0], ranked[-1]) if ranked else (), strict=False):
            rows.append(
                (group.label, name, number(value), person_of(run.settings), str(runs.seed_of(run)), str(run.path))
            )
    header = ("group", "run", metric, "person", "seed", "recording")
    return f"best and worst runs by {metric}", Table(header, tuple(rows), frozenset((metric, "seed")))


def group_csv(grouping: Grouping) -> str:
    """Write one row a group and metric: the keys that varied, n, mean, standard deviation, interval."""
    keys = grouping.variation.keys
    header = (
        "group",
        *short_names(keys).values(),
        "metric",
        "n",
        "people",
        "mean",
        "sd_people",
        "sd",
        "low_95",
        "high_95",
    )
    rows = [
        (group.label, *_cells(group, keys), metric, found.n, found.people, *_floats(found))
        for metric in metric_names(grouping.groups)
        for group in grouping.groups
        if (found := statistic(group, metric)) is not None
    ]
    return comma_separated(header, rows)


def _floats(found: Statistic) -> tuple[float, ...]:
    return found.mean, found.sd_people, found.sd, found.low, found.high


def run_csv(grouping: Grouping) -> str:
    """Write one row a complete run and metric, tidy."""
    keys = grouping.variation.keys
    header = ("recording", "group", *short_names(keys).values(), "person", "seed", "metric", "value")
    rows = [
        (str(run.path), group.label, *_cells(group, keys), person_of(run.settings), runs.seed_of(run), metric, value)
        for group in grouping.groups
        for run in group.runs
        for metric, value in sorted(runs.numbers(run).items())
    ]
    return comma_separated(header, rows)


def _cells(group: Group, keys: Sequence[str]) -> list[str]:
    return [shown(key, group.values[key]) if key in group.values else "" for key in keys]
