"""What differs between two runs: configuration, code, inputs and result."""

from collections.abc import Mapping
from typing import Any

from workbench.results.entry import Entry
from workbench.results.report.tables import Table, number

_PLACES = ("paths.", "threads", "recorder.", "seed")
_LONGEST = 60
_HEADER = ("what", "key", "A", "B", "B − A")


def difference(first: Entry, second: Entry) -> Table:
    """A row for every key of the configuration, of the code and of the result that differs; the seed first."""
    rows = [("run", "seed", *map(str, (first.seed, second.seed)), "")] if first.seed != second.seed else []
    rows += _texts("choice", first.choices, second.choices)
    rows += [row for row in _texts("configuration", first.settings, second.settings) if not row[1].startswith(_PLACES)]
    rows += _texts("code", _origin(first), _origin(second))
    rows += _numbers(first.metrics, second.metrics)
    return Table(_HEADER, tuple(rows), frozenset(("A", "B", "B − A")))


def _texts(what: str, first: Mapping[str, Any], second: Mapping[str, Any]) -> list[tuple[str, ...]]:
    keys = list(dict.fromkeys([*first, *second]))
    pairs = [(key, _text(first, key), _text(second, key)) for key in keys]
    return [(what, _short(key), a, b, "") for key, a, b in pairs if a != b]


def _origin(entry: Entry) -> dict[str, Any]:
    """What a run comes from; each of its inputs is a key of its own, and the command says nothing that keys do not."""
    origin = {key: value for key, value in entry.origin.items() if key not in ("command", "inputs", "seed", "given")}
    inputs = entry.origin.get("inputs") or []
    pairs = (str(each).rpartition(" ") for each in ([inputs] if isinstance(inputs, str) else inputs))
    return origin | {f"input {name}": digest for name, _, digest in pairs}


def _numbers(first: Mapping[str, float], second: Mapping[str, float]) -> list[tuple[str, ...]]:
    keys = list(dict.fromkeys([*first, *second]))
    nan = float("nan")
    pairs = [(key, first.get(key, nan), second.get(key, nan)) for key in keys]
    return [("result", _short(key), number(a), number(b), number(b - a)) for key, a, b in pairs if a != b]


def _text(values: Mapping[str, Any], key: str) -> str:
    if key not in values:
        return "–"
    return _short(" ".join(str(values[key]).split()))


def _short(words: str) -> str:
    return words if len(words) <= _LONGEST else f"{words[: _LONGEST - 1]}…"
