"""Runs as a table: the columns that are asked for, or what a person wants to see first."""

import json
from collections.abc import Sequence

from workbench.evaluation.headline import ERRORS, SHORT_TITLES
from workbench.results.entry import Entry
from workbench.results.query import check_keys, shown, value_of
from workbench.results.report.tables import Table, comma_separated
from workbench.results.report.variation import flat, label, what_varied

USUAL = ("path", "started", "status", "experiment", "varied", "seed", *SHORT_TITLES)
VARIED = "varied"
"""The column of what tells the runs listed from one another."""
_LONGEST = 80
_NUMBERS = frozenset((*SHORT_TITLES, "seed", "size"))


def sort(entries: Sequence[Entry], key: str | None) -> list[Entry]:
    """Sort by a key's value, smallest first, or largest first by -key; runs without it come last. None: as they are."""
    if key is None:
        return list(entries)
    name = key.removeprefix("-")
    check_keys(entries, [name])
    known = [entry for entry in entries if value_of(entry, name) is not None]
    unknown = [entry for entry in entries if value_of(entry, name) is None]
    known.sort(key=lambda entry: _order(entry, name), reverse=key.startswith("-"))
    return known + unknown


def best_first(entries: Sequence[Entry]) -> list[Entry]:
    """The complete runs by the first of ERRORS that any has, smallest first."""
    complete = [entry for entry in entries if entry.status == "complete"]
    name = next((name for name in ERRORS if any(name in entry.metrics for entry in complete)), None)
    return complete if name is None else sorted(complete, key=lambda run: run.metrics.get(name, float("inf")))


def table(entries: Sequence[Entry], columns: Sequence[str] | None) -> Table:
    """A row for each run. columns: keys as in a query; None: USUAL, but for those that are empty."""
    names = list(USUAL if columns is None else columns)
    check_keys(entries, [name for name in names if name != VARIED and columns is not None])
    told = varied(entries) if VARIED in names else []
    rows = [[_cut(name, told[k] if name == VARIED else shown(value_of(entry, name))) for name in names]
            for k, entry in enumerate(entries)]  # fmt: skip
    if columns is None:
        full = [k for k, name in enumerate(names) if name == "path" or any(row[k] for row in rows)]
        names, rows = [names[k] for k in full], [[row[k] for k in full] for row in rows]
    return Table(tuple(_cut("", name) for name in names), tuple(map(tuple, rows)), _NUMBERS)


def _cut(name: str, cell: str) -> str:
    """A cell as long as a line can take; a path is whole, as it may be typed again."""
    return cell if len(cell) <= _LONGEST or name == "path" else f"{cell[: _LONGEST - 1]}…"


def varied(entries: Sequence[Entry]) -> list[str]:
    """Say what tells each of the runs from the others, as `workbench report` does; empty where nothing does."""
    settings = [flat(entry.settings, entry.experiment) for entry in entries]
    keys = [key for key in what_varied(settings).keys if key != "experiment"]
    return [label(keys, values) for values in settings]


def as_json(entries: Sequence[Entry]) -> str:
    """Everything that is known of the runs, a list."""
    return json.dumps([entry.plain for entry in entries], indent=1)


def as_csv(entries: Sequence[Entry], columns: Sequence[str] | None) -> str:
    """The same columns as the table, or without any named the fields and all numbers."""
    if columns is None:
        numbers = sorted({name for entry in entries for name in entry.metrics})
        columns = ["path", "started", "status", "experiment", "seed", *numbers]
    check_keys(entries, [name for name in columns if name != VARIED])
    told = varied(entries) if VARIED in columns else []
    rows = [[told[k] if name == VARIED else _cell(entry, name) for name in columns] for k, entry in enumerate(entries)]
    return comma_separated(columns, rows)


def _cell(entry: Entry, name: str) -> str | float:
    value = entry.seed if name == "seed" else value_of(entry, name)
    return "" if value is None else value


def _order(entry: Entry, name: str) -> tuple[bool, float, str]:
    """Numbers before texts, each in their order."""
    value = value_of(entry, name)
    return (False, value, "") if isinstance(value, float) else (True, 0.0, str(value))


def sweeps(entries: Sequence[Entry]) -> Table:
    """A row for each sweep that the runs are jobs of: how many there are, and how they ended."""
    jobs: dict[str, list[Entry]] = {}
    for entry in entries:
        if entry.sweep:
            jobs.setdefault(entry.sweep, []).append(entry)
    rows = []
    for folder, each in jobs.items():
        ended = [entry.status for entry in each]
        others = ", ".join(f"{ended.count(status)} {status}" for status in sorted(set(ended)) if status != "complete")
        best = next(iter(best_first(each)), None)
        error = next((f"{name} {best.metrics[name]:.4g}" for name in ERRORS if best and name in best.metrics), "")
        newest = max(entry.started for entry in each)
        rows.append((folder, newest, each[0].experiment, str(len(each)), str(ended.count("complete")), others, error))
    header = ("sweep", "newest run", "experiment", "jobs", "complete", "others", "best")
    return Table(header, tuple(rows), frozenset(("jobs", "complete")))
