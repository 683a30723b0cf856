"""Tables as plain text, Markdown, HTML and CSV."""

import csv
import html
import math
from collections.abc import Sequence
from dataclasses import dataclass
from io import StringIO


@dataclass(frozen=True)
class Table:
    """Rows of text below a header. A column whose name is in `numeric` is aligned to the right."""

    header: tuple[str, ...]
    rows: tuple[tuple[str, ...], ...]
    numeric: frozenset[str] = frozenset()


def number(value: float) -> str:
    """Write four significant digits, or all of them before the point; a dash for what is not known."""
    if not math.isfinite(value):
        return "–"
    if abs(value) < 1e-12:  # nothing, or what rounding leaves of it
        return "0"
    return f"{value:.0f}" if abs(value) >= 1000.0 else f"{value:#.4g}".rstrip(".")


def text(table: Table) -> str:
    """Align columns for the terminal, every row in one line."""
    rows = [[printable(cell) for cell in row] for row in (table.header, *table.rows)]
    widths = [max(map(len, column)) for column in zip(*rows, strict=True)]

    def line(cells: Sequence[str]) -> str:
        aligned = [
            cell.rjust(width) if name in table.numeric else cell.ljust(width)
            for name, cell, width in zip(table.header, cells, widths, strict=True)
        ]
        return "  ".join(aligned).rstrip()

    return "\n".join(map(line, rows))


def printable(words: str) -> str:
    """Replace what steers a terminal by spaces, which names in a stranger's recording may hold; one line."""
    return "".join(letter if letter.isprintable() else " " for letter in words)


def markdown(table: Table) -> str:
    """Write a pipe table."""
    rule = ["---:" if name in table.numeric else "---" for name in table.header]
    rows = [[escaped(cell) for cell in row] for row in (table.header, *table.rows)]
    return "\n".join(f"| {' | '.join(row)} |" for row in (rows[0], rule, *rows[1:]))


def escaped(words: str) -> str:
    """Escape text of others for Markdown: nothing in it is markup, and it stays within its cell."""
    for mark in "\\|`*_<>[]":
        words = words.replace(mark, f"\\{mark}")
    return " ".join(words.split())


def markup(table: Table) -> str:
    """Write an HTML table; cells of numeric columns have the class `number`."""
    kinds = [' class="number"' if name in table.numeric else "" for name in table.header]

    def line(cells: Sequence[str], tag: str) -> str:
        filled = zip(cells, kinds, strict=True)
        return "<tr>" + "".join(f"<{tag}{kind}>{html.escape(cell)}</{tag}>" for cell, kind in filled) + "</tr>"

    body = "\n".join(line(row, "td") for row in table.rows)
    return f"<table>\n<thead>{line(table.header, 'th')}</thead>\n<tbody>\n{body}\n</tbody>\n</table>"


def comma_separated(header: Sequence[str], rows: Sequence[Sequence[object]]) -> str:
    """Write CSV with a header; floats in full, nothing where a number is not finite."""
    file = StringIO()
    writer = csv.writer(file, lineterminator="\n")
    writer.writerow(header)
    for row in rows:
        writer.writerow(["" if isinstance(cell, float) and not math.isfinite(cell) else cell for cell in row])
    return file.getvalue()
