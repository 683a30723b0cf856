"""How all figures look: sizes, colours that every kind of colour vision tells apart, labels beside what they name."""

import textwrap
from collections.abc import Sequence
from typing import Any

from matplotlib.axes import Axes
from matplotlib.figure import Figure, SubFigure
from matplotlib.patheffects import withStroke

WIDTH_IN = 7.0
INK, GREY, FAINT = "#222222", "#767676", "#C9C9C9"
ESTIMATE, TRUTH, POINTS = "#D55E00", "#0072B2", "#111111"
ON_IMAGE = {"particles": "#E8A6FF", "estimate": "#FF9F1C", "truth": "#40C4FF"}
"""The recorder's colours, for dark images."""
SERIES = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#E69F00", "#56B4E9", "#222222")
"""After Okabe & Ito."""
DASHES = ("-", (0, (5, 2)), (0, (1, 1.5)), "-.", (0, (3, 1, 1, 1, 1, 1)), "-", "-")
"""Of the series in the same order, so that they can be told apart in print without colours."""
HALO = withStroke(linewidth=2.0, foreground="white")

STYLE: dict[str, Any] = {
    "font.size": 8.0, "axes.titlesize": 8.5, "axes.titlelocation": "left", "axes.labelsize": 8.0,
    "xtick.labelsize": 7.5, "ytick.labelsize": 7.5, "axes.spines.top": False, "axes.spines.right": False,
    "axes.edgecolor": GREY, "axes.labelcolor": INK, "text.color": INK, "xtick.color": GREY, "ytick.color": GREY,
    "xtick.labelcolor": INK, "ytick.labelcolor": INK, "axes.linewidth": 0.6, "xtick.major.width": 0.6,
    "ytick.major.width": 0.6, "lines.linewidth": 1.3, "lines.solid_capstyle": "round", "savefig.dpi": 200,
    "savefig.facecolor": "white", "pdf.fonttype": 42,
}  # fmt: skip
"""For matplotlib.style.context."""


def canvas(title: str, height_in: float, caption: str) -> Figure:
    """An empty figure of the usual width with a title; the caption says our numbers, and the paper's beside them."""
    figure = Figure(figsize=(WIDTH_IN, height_in), layout="constrained")
    figure.suptitle(title, x=0.008, ha="left", fontsize=9.5, fontweight="bold")
    figure.supxlabel(textwrap.fill(caption, 128), x=0.008, ha="left", fontsize=7.5, color=INK, linespacing=1.35)
    return figure


def rows(figure: Figure, heights: Sequence[float], titles: Sequence[str]) -> list[SubFigure]:
    """The figure cut into rows, each with its title."""
    parts: list[SubFigure] = list(figure.subfigures(len(heights), 1, height_ratios=heights, squeeze=False)[:, 0])
    for part, title in zip(parts, titles, strict=True):
        part.suptitle(title, x=0.008, ha="left", fontsize=8.5)
    return parts


def bare(axes: Axes) -> None:
    """Nothing but what is drawn: no axes, equal units."""
    axes.set_axis_off()
    axes.set_aspect("equal")


def label_ends(axes: Axes, ends: Sequence[tuple[str, str, float, float]], gap: float = 0.09) -> None:
    """Labels (text, colour, x, y) to the right of lines' ends, pushed apart to `gap`, a part of the axes' height.

    After the axes' limits are set.
    """
    scale = axes.yaxis.get_transform()
    low, high = scale.transform(axes.get_ylim())
    ordered = sorted(ends, key=lambda end: end[3])
    heights = [float((scale.transform([y])[0] - low) / (high - low)) for _, _, _, y in ordered]
    placed: list[float] = []
    for height in heights:
        placed.append(max(height, placed[-1] + gap) if placed else height)
    excess = max([0.0, *(new - old for new, old in zip(placed, heights, strict=True))])
    for (text, colour, x, _), height in zip(ordered, placed, strict=True):
        axes.annotate(
            text, (x, height - 0.5 * excess), (4.0, 0.0), xycoords=("data", "axes fraction"),
            textcoords="offset points", va="center", color=colour, fontsize=7.5, path_effects=[HALO],
            annotation_clip=False,
        )  # fmt: skip
