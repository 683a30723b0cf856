"""Conditions on runs, such as `prior=smooth` or `mpjpe_abs_mm<40`, their order, and the listed columns."""

import operator
import re
from collections.abc import Callable, Iterable, Sequence
from difflib import get_close_matches
from typing import Any

import numpy as np
import pandas as pd

from workbench.evaluation.metrics import HEADLINE_ERRORS, SHORT_TITLES
from workbench.results.formatting import number, table_of
from workbench.results.report.variation import EXPERIMENT, flat, label, what_varied
from workbench.results.table import FIELDS, SECTIONS, records_of
from workbench.utils.errors import InputError

Condition = tuple[str, str, str]
"""Key, sign and value."""
USUAL = ("path", "started", "status", "experiment", "varied", "seed", *SHORT_TITLES)
_VARIED = "varied"
"""Column with the differences of a run's configuration from the others'."""
_CONDITION = re.compile(r"([\w./@-]+?)(<=|>=|!=|=|<|>|~)(.*)", re.DOTALL)
_ORDERS: dict[str, Callable[[Any, Any], bool]] = {
    "<": operator.lt, "<=": operator.le, ">": operator.gt, ">=": operator.ge,
}  # fmt: skip


def parse_condition(word: str) -> Condition | None:
    """Return the condition `key<value`, or None for another word; raises InputError for a wrong regular expression."""
    if (match := _CONDITION.fullmatch(word)) is None:
        return None
    key, sign, value = match.groups()
    if sign == "~":
        try:
            re.compile(value)
        except re.error as error:
            raise InputError(f"{word}: expected a regular expression after ~: {error}") from None
    return key, sign, value


def select(runs: pd.DataFrame, conditions: Iterable[Condition]) -> pd.DataFrame:
    """Return the runs that satisfy all conditions.

    = and != compare with any of several values, ~ searches for a regular expression, the others compare numbers with
    numbers and text with text. A run without the key satisfies only !=. Raises InputError for a key that no run has.
    """
    satisfied = np.ones(len(runs), dtype=bool)
    for key, sign, value in conditions:
        satisfied &= [_holds(each, sign, value) for each in values_of(runs, key)]
    return runs[satisfied]


def values_of(runs: pd.DataFrame, key: str) -> list[Any]:
    """Return the runs' values of a key: numbers, text, or None; raises InputError for a key that no run has.

    The key is one of FIELDS, a chosen option (prior), a metric, a key of the configuration or of the provenance, or the
    end of a configuration's key, such as n_particles of inference.n_particles; the shortest such key counts.
    """
    if key in FIELDS:
        return [_plain(value) for value in runs[key]]
    ends = sorted((name for name in runs if name.startswith("settings.") and name.endswith(f".{key}")), key=len)
    values = pd.Series(None, index=runs.index, dtype=object)
    for name in (*(f"{section}.{key}" for section in SECTIONS), *ends):
        if name in runs:
            values = values.where(values.notna(), runs[name])
    if len(runs) and values.isna().all():
        keys = {name.partition(".")[2] for name in runs} | {name.rpartition(".")[2] for name in runs}
        near = get_close_matches(key, sorted(keys), n=3)
        hint = f"; did you mean {' or '.join(near)}?" if near else ""
        raise InputError(f"{key}: no run has a metric, a choice or a key of this name{hint}")
    return [None if value is None or value != value else _plain(value) for value in values]


def sort_runs(runs: pd.DataFrame, key: str | None) -> pd.DataFrame:
    """Return runs sorted by a key, ascending, or descending by -key; numbers before text, runs without the key last."""
    if key is None:
        return runs
    values = values_of(runs, key.removeprefix("-"))
    order = [k for k, value in enumerate(values) if value is not None]
    order.sort(key=lambda k: (isinstance(values[k], str), values[k]), reverse=key.startswith("-"))
    return runs.iloc[order + [k for k, value in enumerate(values) if value is None]]


def best_first(runs: pd.DataFrame) -> pd.DataFrame:
    """Return the complete runs sorted by the first of HEADLINE_ERRORS that any has."""
    complete = runs[runs["status"] == "complete"].dropna(axis="columns", how="all")
    name = next((f"metrics.{name}" for name in HEADLINE_ERRORS if f"metrics.{name}" in complete), None)
    return complete if name is None else complete.sort_values(name, kind="stable")


def listing(runs: pd.DataFrame, columns: Sequence[str] | None) -> pd.DataFrame:
    """Return a table of columns, named by keys as in a query; None: those of USUAL that are not empty."""
    names = [name for name in USUAL if name in (*FIELDS, _VARIED) or f"metrics.{name}" in runs]
    cells = {name: varied(runs) if name == _VARIED else values_of(runs, name) for name in columns or names}
    if columns is None:
        cells = {name: values for name, values in cells.items() if any(value not in ("", None) for value in values)}
    return table_of(list(cells), zip(*cells.values(), strict=True))


def varied(runs: pd.DataFrame) -> list[str]:
    """Return the differences of each run's configuration from the others', as text."""
    settings = [flat(record["settings"], record[EXPERIMENT]) for record in records_of(runs)]
    keys = [key for key in what_varied(settings).keys if key != EXPERIMENT]
    return [label(keys, values) for values in settings]


def sweeps(runs: pd.DataFrame) -> pd.DataFrame:
    """Return a row for each sweep of the runs: number of jobs, their status, and the best."""
    rows = []
    for folder in dict.fromkeys(filter(None, runs["sweep"])):
        jobs = runs[runs["sweep"] == folder]
        ended, best = jobs["status"].value_counts(), best_first(jobs)
        error = next((name for name in HEADLINE_ERRORS if f"metrics.{name}" in best), None)
        others = ", ".join(f"{n} {status}" for status, n in sorted(ended.items()) if status != "complete")
        first = "" if error is None else f"{error} {number(best[f'metrics.{error}'].iloc[0])}"
        n_complete = int(ended.get("complete", 0))
        rows.append((folder, jobs["started"].max(), jobs["experiment"].iloc[0], len(jobs), n_complete, others, first))
    return table_of(("sweep", "newest run", "experiment", "jobs", "complete", "others", "best"), rows)


def _holds(value: Any, sign: str, word: str) -> bool:
    if sign in ("=", "!="):
        return any(_equal(value, each) for each in word.split(",")) == (sign == "=")
    if sign == "~":
        return value is not None and re.search(word, str(value)) is not None
    bound = _number(word)
    if value is None or isinstance(value, str) != (bound is None):
        return False
    return _ORDERS[sign](value, word if bound is None else bound)


def _equal(value: Any, word: str) -> bool:
    if isinstance(value, int | float):
        return value == _number(word)
    return (value or "none").casefold() == word.casefold()


def _number(word: str) -> float | None:
    try:
        return float(word)
    except ValueError:
        return None


def _plain(value: Any) -> str | int | float | None:
    if isinstance(value, bool):
        return str(value).lower()
    return value if value is None or isinstance(value, str | int | float) else str(value)
