"""The report as text, as Markdown, and as one self-contained HTML page."""

from base64 import b64encode
from collections.abc import Sequence
from dataclasses import dataclass

from jinja2 import Environment, PackageLoader, StrictUndefined, select_autoescape

from workbench.results.formatting import cells, numeric, printable, text
from workbench.results.report.contents import Contents


@dataclass(frozen=True)
class Plot:
    """A plot as PNG. name: of its file. caption: what it shows, one or two sentences."""

    name: str
    title: str
    caption: str
    png: bytes


def terminal(found: Contents) -> str:
    """Return the report as plain text, without the other metrics."""
    parts = ["\n".join(found.summary)]
    if found.problems:
        parts.append("\n".join(("not counted or missing:", *(f"- {problem}" for problem in found.problems))))
    parts += [f"{title}\n{text(table)}" for title, table in found.tables.items()]
    return "\n".join(map(printable, "\n\n".join(parts).split("\n")))


def escaped(words: str) -> str:
    """Escape untrusted text for Markdown: nothing in it is markup, and it stays within its cell."""
    for mark in "\\|`*_<>[]":
        words = words.replace(mark, f"\\{mark}")
    return " ".join(words.split())


def render(template: str, title: str, found: Contents, plots: Sequence[Plot]) -> str:
    """Return the report as `report.md`, which shows the plots that lie next to it, or as `report.html` with its plots
    inside, which has no scripts and forbids itself to load anything."""
    environment = Environment(
        loader=PackageLoader("workbench.results.report", "."), autoescape=select_autoescape(["html"]),
        undefined=StrictUndefined, trim_blocks=True, lstrip_blocks=True, keep_trailing_newline=True,
    )  # fmt: skip
    environment.filters |= {"escaped": escaped, "base64": lambda data: b64encode(data).decode("ascii")}
    environment.globals |= {"cells": cells, "numeric": numeric}
    return environment.get_template(template).render(title=title, plots=plots, **found._asdict())
