"""Numbers and tables as text for a terminal."""

from collections.abc import Iterable, Sequence
from math import isfinite
from numbers import Real
from typing import Any

import pandas as pd

from workbench.utils.text import printable


def number(value: float) -> str:
    """Return four significant digits, or all digits before the point; a dash for a value that is not finite."""
    if not isfinite(value):
        return "–"
    if abs(value) < 1e-12:  # zero but for rounding
        return "0"
    return f"{value:.0f}" if abs(value) >= 1000.0 else f"{value:#.4g}".rstrip(".")


def cell(value: Any) -> str:
    """Return a table's cell as text: integers in full, other numbers by `number`, None as \"\"."""
    if value is None:
        return ""
    return number(value) if isinstance(value, float) else str(value)


def table_of(header: Sequence[str], rows: Iterable[Sequence[Any]]) -> pd.DataFrame:
    """Return a table of objects without any conversion of cells and names."""
    return pd.DataFrame(list(rows), columns=pd.Index(header, dtype=object), dtype=object)


def cells(table: pd.DataFrame) -> list[list[str]]:
    """Return the names of a table's columns, and its rows, as text."""
    rows = table.itertuples(index=False, name=None)
    return [list(map(str, table.columns)), *([cell(value) for value in row] for row in rows)]


def numeric(table: pd.DataFrame) -> list[bool]:
    """Return for each column whether all its values are numbers, which are aligned to the right."""
    columns = [[value for value in values if value is not None] for _, values in table.items()]
    return [
        bool(values) and all(isinstance(value, Real) and not isinstance(value, bool) for value in values)
        for values in columns
    ]


def text(table: pd.DataFrame, longest: int | None = None) -> str:
    """Return a table as text for the terminal, a line for each row.

    longest: characters that cells are cut to, except in the column `path`, which a user may copy.
    """
    columns = []
    for name, right, column in zip(table, numeric(table), zip(*cells(table), strict=True), strict=True):
        words = list(map(printable, column))
        if longest is not None and name != "path":
            words = [each if len(each) <= longest else f"{each[: longest - 1]}…" for each in words]
        width = max(map(len, words))
        columns.append([each.rjust(width) if right else each.ljust(width) for each in words])
    return "\n".join("  ".join(row).rstrip() for row in zip(*columns, strict=True))
