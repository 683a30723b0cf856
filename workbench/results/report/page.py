"""Reports as text, as Markdown, and as a self-contained HTML page."""

from base64 import b64encode
from collections.abc import Sequence
from dataclasses import dataclass

from workbench.results.formatting import text
from workbench.results.pages import environment
from workbench.results.report.contents import Contents
from workbench.utils.text import printable


@dataclass(frozen=True)
class Plot:
    """A plot as PNG. name: of its file. caption: one or two sentences."""

    name: str
    title: str
    caption: str
    png: bytes


def terminal(contents: Contents) -> str:
    """Return the report as plain text, without the other metrics."""
    parts = ["\n".join(contents.summary)]
    if contents.problems:
        parts.append("\n".join(("excluded or missing:", *(f"- {problem}" for problem in contents.problems))))
    parts += [f"{title}\n{text(table)}" for title, table in contents.tables.items()]
    return "\n".join(map(printable, "\n\n".join(parts).split("\n")))


def escaped(words: str) -> str:
    """Return untrusted text escaped for a cell of a Markdown table."""
    for mark in "\\|`*_<>[]":
        words = words.replace(mark, f"\\{mark}")
    return " ".join(words.split())


def render(template: str, title: str, contents: Contents, plots: Sequence[Plot]) -> str:
    """Return the report by the template report.md, with links to the plots, or report.html, with embedded plots and
    without scripts and loading."""
    pages = environment()
    pages.filters |= {"escaped": escaped, "base64": lambda data: b64encode(data).decode("ascii")}
    return pages.get_template(f"report/{template}").render(title=title, plots=plots, **contents._asdict())
