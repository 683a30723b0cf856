"""Layout of the papers' figures: width, title, caption, rows."""

import textwrap
from collections.abc import Sequence

from matplotlib.axes import Axes
from matplotlib.figure import Figure, SubFigure

from workbench.recording.study.drawing import INK

WIDTH_IN = 7.0
POINTS = "#111111"
ON_IMAGE = {"particles": "#E8A6FF", "estimate": "#FF9F1C", "truth": "#40C4FF"}
"""The recorder's colours, for dark images."""


def canvas(title: str, height_in: float, caption: str) -> Figure:
    """Return an empty figure of the standard width with a title; the caption compares our results with the paper's."""
    figure = Figure(figsize=(WIDTH_IN, height_in), layout="constrained")
    figure.suptitle(title, x=0.008, ha="left", fontsize=9.5, fontweight="bold")
    figure.supxlabel(textwrap.fill(caption, 120), x=0.008, ha="left", fontsize=7.5, color=INK, linespacing=1.35)
    return figure


def rows(figure: Figure, heights: Sequence[float], titles: Sequence[str]) -> list[SubFigure]:
    """Return the figure's rows, each with its title."""
    parts: list[SubFigure] = list(figure.subfigures(len(heights), 1, height_ratios=heights, squeeze=False)[:, 0])
    for part, title in zip(parts, titles, strict=True):
        part.suptitle(title, x=0.008, ha="left", fontsize=8.5)
    return parts


def bare(axes: Axes) -> None:
    """Remove the axes and set equal units."""
    axes.set_axis_off()
    axes.set_aspect("equal")
