"""A table over people and seeds: rows of runs, and columns that summarize their metrics, as Markdown."""

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import TypeAlias

import numpy as np

from analysis.figures.cached_runs import Run
from analysis.figures.recordings import Source
from analysis.figures.unrecorded import Result
from workbench.evaluation.uncertainty.intervals import bootstrap_interval
from workbench.motion.formats.names import performer

Labels: TypeAlias = tuple[str, ...]
Results: TypeAlias = Mapping[Run, Result | None]
"""None for a run that is not cached, where only cached ones are shown."""
NONE = "–"


@dataclass(frozen=True)
class Column:
    """A column. value: of the results of a row, all of which are known; NaN is shown as a dash. digits: after the
    point; None: one below 20, none above."""

    name: str
    value: Callable[[Mapping[Run, Result]], float]
    digits: int | None = 0

    def cell(self, results: Results) -> str:
        """Return the cell of a row."""
        known = {run: result for run, result in results.items() if result is not None}
        value = self.value(known) if known and len(known) == len(results) else np.nan
        digits = (0 if abs(value) >= 20.0 else 1) if self.digits is None else self.digits
        return f"{value:.{digits}f}" if np.isfinite(value) else NONE


@dataclass(frozen=True)
class Table:
    """A table of a page. labels: names of the first columns. rows: of a source and a number of seeds, None for the
    default, the runs by the cells of the first columns. mark: labels of the rows to be marked, and what that means."""

    labels: Labels
    rows: Callable[[Source, int | None], Mapping[Labels, Sequence[Run]]]
    columns: Sequence[Column]
    mark: Callable[[Mapping[Labels, Results]], set[Labels]] = lambda _: set()
    meaning: str = ""

    def text(self, results: Mapping[Labels, Results]) -> str:
        """Return the table in Markdown."""
        marked = self.mark(results)
        lines = [[*self.labels, *(column.name for column in self.columns)]]
        lines.append(["---"] * len(lines[0]))
        for labels, row in results.items():
            last = f"{labels[-1]} †" if labels in marked else labels[-1]
            lines.append([*labels[:-1], last, *(column.cell(row) for column in self.columns)])
        note = f"\n† {self.meaning}\n" if marked else ""
        return markdown(lines) + note


def markdown(lines: Iterable[Sequence[str]]) -> str:
    """Return a table in Markdown. lines: cells of the header, of the rule below it and of the rows."""
    return "".join(f"| {' | '.join(line)} |\n" for line in lines)


def person(run: Run) -> str:
    """Return the person whom a run shows: the performer of its clip, or a data set whose performers are unknown."""
    return performer(run.clip) or run.clip


def of_people(results: Mapping[Run, Result], metric: str, statistic: Callable[..., float] = np.mean) -> list[float]:
    """Return a statistic over the runs of each person; NaN for a metric that runs lack."""
    values: dict[str, list[float]] = {}
    for run, result in results.items():
        values.setdefault(person(run), []).append(result.metrics.get(metric, np.nan))
    return [float(statistic(each)) for each in values.values()]


def deviation(values: Sequence[float]) -> float:
    """Return the standard deviation; NaN for fewer than two values."""
    return float(np.std(values, ddof=1)) if len(values) > 1 else float("nan")


def mean(metric: str, digits: int | None = 0, name: str = "") -> Column:
    """Return the column of the mean over people of their means over runs."""
    return Column(name or f"`{metric}`", lambda results: float(np.mean(of_people(results, metric))), digits)


def between_people(metric: str, digits: int | None = 0, name: str = "SD") -> Column:
    """Return the column of the standard deviation between people's means."""
    return Column(name, lambda results: deviation(of_people(results, metric)), digits)


def between_seeds(metric: str, digits: int | None = 0, name: str = "SD between seeds") -> Column:
    """Return the column of the mean standard deviation between the runs of one person."""
    return Column(name, lambda results: float(np.mean(of_people(results, metric, deviation))), digits)


def interval(metric: str, digits: int | None = None) -> list[Column]:
    """Return the columns of the ends of the mean's 95 % bootstrap interval over the runs."""

    def end(k: int) -> Callable[[Mapping[Run, Result]], float]:
        def value(results: Mapping[Run, Result]) -> float:
            values = np.array([result.metrics.get(metric, np.nan) for result in results.values()])
            return float(bootstrap_interval(values, np.random.default_rng(0))[k])

        return value

    return [Column("95 % CI from", end(0), digits), Column("to", end(1), digits)]


def over_runs(metric: str, statistic: Callable[..., float], digits: int | None = 0, name: str = "") -> Column:
    """Return the column of a statistic over all runs."""

    def value(results: Mapping[Run, Result]) -> float:
        return float(statistic([result.metrics.get(metric, np.nan) for result in results.values()]))

    return Column(name or f"`{metric}`", value, digits)


PEOPLE = Column("subjects", lambda results: len({person(run) for run in results}))
RUNS = Column("runs", len)
TRACKED = over_runs("tracked", np.sum, name="tracked runs")
