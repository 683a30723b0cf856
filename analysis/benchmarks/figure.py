"""A measured figure with its required value, as text and as JSON."""

import json
import math
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path

from analysis.tables.table import markdown
from workbench.results.formatting import table_of, text
from workbench.utils.atomic_write import whole_file
from workbench.utils.errors import InputError

BETTER = ("lower", "higher")
_COLUMNS = ("benchmark", "value", "goal", "unit", "reached", "reference or peer")


@dataclass(frozen=True)
class Figure:
    """One line of the table of benchmarks.

    value: in `unit`, above 0. bar: what it must reach, in the same unit. better: "lower" or "higher". reference: the
    peer or bound it was measured against, with that one's own figure.
    """

    name: str
    value: float
    unit: str
    bar: float
    better: str
    reference: str

    def __post_init__(self) -> None:
        if self.better not in BETTER or not 0.0 < self.value < math.inf:
            raise ValueError(f"{self.name}: expected a value above 0 and {' or '.join(BETTER)}, found {self}")

    @property
    def reached(self) -> bool:
        """Return whether the figure is at its bar or better."""
        return self.value <= self.bar if self.better == "lower" else self.value >= self.bar


def table(figures: Sequence[Figure]) -> str:
    """Lay the figures out as text, one a line."""
    return text(table_of(_COLUMNS, map(_row, figures)))


def page_table(figures: Sequence[Figure]) -> str:
    """Return the table of values and goals in Markdown, without the references."""
    return markdown([_COLUMNS[:-1], ["---"] * 5, *([f"`{name}`", *cells[:-1]] for name, *cells in map(_row, figures))])


def _row(figure: Figure) -> tuple[str, ...]:
    bar = f"{'≤' if figure.better == 'lower' else '≥'} {figure.bar:.3g}"
    return figure.name, f"{figure.value:.3g}", bar, figure.unit, "yes" if figure.reached else "no", figure.reference


def write_figures(path: Path, figures: Sequence[Figure]) -> None:
    """Write a JSON list of {name, value, unit, bar, better, reference}, and `page_table` to a .md file of this name.

    Raises InputError when a file cannot be written.
    """
    rows = json.dumps([asdict(figure) for figure in figures], indent=1, ensure_ascii=False)
    for target, content in ((path, f"{rows}\n"), (path.with_suffix(".md"), page_table(figures))):
        with whole_file(target) as part:
            part.write_text(content, encoding="utf-8")


def read_figures(path: Path) -> list[Figure]:
    """Return the figures of a file written by `write_figures`; raises InputError if it is missing or has another
    format."""
    try:
        rows = json.loads(path.read_text(encoding="utf-8"))
        return [Figure(**row | {"value": float(row["value"])}) for row in rows]
    except (OSError, ValueError, TypeError, KeyError) as error:
        raise InputError(f"{path}: expected a list of benchmark figures in JSON: {error}") from None


def differences(measured: Sequence[Figure], reference: Sequence[Figure], share: float) -> list[str]:
    """Return a line for each figure that is more than (1 + share) times worse, or that only one side has."""
    ours, theirs = ({figure.name: figure for figure in figures} for figures in (measured, reference))
    lines = [f"{name}: measured or in the reference, not both" for name in sorted(ours.keys() ^ theirs.keys())]
    for now, then in ((ours[name], theirs[name]) for name in ours if name in theirs):
        ratio = now.value / then.value if then.better == "lower" else then.value / now.value
        if ratio > 1.0 + share or (now.unit, now.better) != (then.unit, then.better):
            lines.append(f"{now.name}: {now.value:.3g} {now.unit}, was {then.value:.3g} {then.unit}")
    return lines
