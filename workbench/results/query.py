"""Conditions on runs, such as `prior=smooth`, `error_abs_mm<40`, `started>2026-11-01`."""

import difflib
import operator
import re
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from typing import Any

from workbench.results.entry import Entry
from workbench.utils.errors import InputError

Value = str | float | None
OWN = ("status", "experiment", "seed", "started", "size", "path", "sweep", "error")
_MOST_WHOLE = 2.0**53
"""From here on, not every whole number is a float."""
_CONDITION = re.compile(r"([\w./@-]+?)(<=|>=|!=|=|<|>|~)(.*)", re.DOTALL)
_ORDERS: dict[str, Callable[[Any, Any], bool]] = {
    "<": operator.lt, "<=": operator.le, ">": operator.gt, ">=": operator.ge,
}  # fmt: skip


@dataclass(frozen=True)
class Condition:
    """key: see `value_of`. sign: = and != with any of several values; ~ a regular expression; or an order."""

    key: str
    sign: str
    value: str

    def holds(self, entry: Entry) -> bool:
        """Whether a run meets it; one that has no such key does not, but for !=."""
        found = value_of(entry, self.key)
        if self.sign in ("=", "!="):
            return any(_equal(found, value) for value in self.value.split(",")) == (self.sign == "=")
        if self.sign == "~":
            return found is not None and re.search(self.value, shown(found)) is not None
        bound = _number(self.value)
        if isinstance(found, float):
            return bound is not None and _ORDERS[self.sign](found, bound)
        return isinstance(found, str) and bound is None and _ORDERS[self.sign](found, self.value)


def condition(word: str) -> Condition | None:
    """Read `key<value`; None for what is no condition. Raises InputError for one that cannot be met."""
    if (match := _CONDITION.fullmatch(word)) is None:
        return None
    key, sign, value = match.groups()
    if sign == "~":
        try:
            re.compile(value)
        except re.error as error:
            raise InputError(f"{word}: expected a regular expression after ~: {error}") from None
    return Condition(key, sign, value)


def chosen(entries: Sequence[Entry], conditions: Iterable[Condition]) -> list[Entry]:
    """The runs that meet all conditions; raises InputError for a key that no run has, with those that are near."""
    conditions = list(conditions)
    check_keys(entries, [each.key for each in conditions])
    return [entry for entry in entries if all(each.holds(entry) for each in conditions)]


def check_keys(entries: Sequence[Entry], keys: Sequence[str]) -> None:
    """Raise InputError for a key that none of the runs has."""
    for key in keys:
        if entries and key not in OWN and all(value_of(entry, key) is None for entry in entries):
            near = difflib.get_close_matches(key, sorted(_keys(entries)), n=3)
            hint = f"; did you mean {' or '.join(near)}?" if near else ""
            raise InputError(f"{key}: no run has a number, a choice or a key of that name{hint}")


def value_of(entry: Entry, key: str) -> Value:
    """What a run has under a key: one of OWN, a chosen part (prior), a number, or a key of its configuration or code.

    A configuration's key may be said by its end, n_particles for inference.n_particles; where several end so, the
    shortest counts. Numbers are floats, everything else is text; None where there is nothing.
    """
    if key in OWN:
        return _plain(getattr(entry, key))
    for known in (entry.choices, entry.metrics, entry.settings, entry.origin):
        if key in known:
            return _plain(known[key])
    ends = [name for name in entry.settings if name.endswith(f".{key}")]
    return _plain(entry.settings[min(ends, key=len)]) if ends else None


def shown(value: Value) -> str:
    """Write a value as a table does: whole numbers, such as a seed, with all their digits."""
    if isinstance(value, float):
        return f"{value:.0f}" if value.is_integer() and abs(value) < _MOST_WHOLE else f"{value:.4g}"
    return "" if value is None else value


def _plain(value: Any) -> Value:
    if value is None or isinstance(value, str):
        return value
    if isinstance(value, bool):
        return str(value).lower()
    return float(value) if isinstance(value, int | float) else str(value)


def _equal(found: Value, word: str) -> bool:
    if isinstance(found, float):
        return found == _number(word)
    return (found or "none").casefold() == word.casefold()


def _number(word: str) -> float | None:
    try:
        return float(word)
    except ValueError:
        return None


def _keys(entries: Sequence[Entry]) -> set[str]:
    whole = {key for entry in entries for known in (entry.choices, entry.metrics, entry.settings) for key in known}
    return whole | {key.rpartition(".")[2] for key in whole} | set(OWN)
