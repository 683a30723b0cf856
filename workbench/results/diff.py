"""Differences between two runs: configuration, code, inputs and results."""

from collections.abc import Iterator, Mapping
from typing import Any

import pandas as pd

from workbench.results.formatting import table_of

_NO_EFFECT = ("paths.", "n_threads", "recorder.", "seed")
_NOT_CODE = ("command", "inputs", "seed", "assumptions")
_LONGEST = 60


def diff(first: Mapping[str, Any], second: Mapping[str, Any]) -> pd.DataFrame:
    """Return a row for each difference of the configuration, the code and the results between two records.

    first, second: see `table.records_of`. Columns: what, key, A, B, B − A; the seed is first.
    """
    rows = [*_rows("run", {"seed": first["seed"]}, {"seed": second["seed"]})]
    rows += _rows("choice", first["choices"], second["choices"])
    rows += [row for row in _rows("configuration", first["settings"], second["settings"])
             if not row[1].startswith(_NO_EFFECT)]  # fmt: skip
    rows += _rows("code", _origin(first["origin"]), _origin(second["origin"]))
    rows += _rows("result", first["metrics"], second["metrics"])
    return table_of(("what", "key", "A", "B", "B − A"), rows)


def _rows(what: str, first: Mapping[str, Any], second: Mapping[str, Any]) -> Iterator[tuple[Any, ...]]:
    for key in dict.fromkeys([*first, *second]):
        a, b = (_short(values[key]) if key in values else None for values in (first, second))
        if a != b:
            change = b - a if what == "result" and a is not None and b is not None else None
            yield what, _short(key), a, b, change


def _origin(origin: Mapping[str, Any]) -> dict[str, Any]:
    """Return the provenance with a key for each input, without redundant keys."""
    inputs = origin.get("inputs") or []
    pairs = (str(each).rpartition(" ") for each in ([inputs] if isinstance(inputs, str) else inputs))
    code = {key: value for key, value in origin.items() if key not in _NOT_CODE}
    return code | {f"input {name}": digest for name, _, digest in pairs}


def _short(value: Any) -> Any:
    """Return a number unchanged, and anything else as text of at most _LONGEST characters."""
    if isinstance(value, int | float) and not isinstance(value, bool):
        return value
    words = " ".join(str(value).split())
    return words if len(words) <= _LONGEST else f"{words[: _LONGEST - 1]}…"
