"""Pages without scripts and loading: HTML that extends page.html, with tables by table.html."""

from jinja2 import Environment, PackageLoader, StrictUndefined, select_autoescape

from workbench.results.formatting import cells, numeric


def environment() -> Environment:
    """Return the environment of the templates, whose names are relative to this package."""
    pages = Environment(
        loader=PackageLoader("workbench.results", "."), autoescape=select_autoescape(["html"]),
        undefined=StrictUndefined, trim_blocks=True, lstrip_blocks=True, keep_trailing_newline=True,
    )  # fmt: skip
    pages.globals |= {"cells": cells, "numeric": numeric}
    return pages
