"""Drawings of curves, bars and scatter plots in one style, for the viewer, reports and the papers' figures.

Rerun's time series views share one timeline and have no axis labels. So a study's figures are drawn by matplotlib and
recorded as images, in addition to their numbers.
"""

from collections.abc import Sequence
from io import BytesIO
from typing import Any, TypeAlias

import numpy as np
import scipy
from matplotlib import figure as plt
from matplotlib.axes import Axes
from matplotlib.patheffects import withStroke
from matplotlib.style import context
from matplotlib.ticker import MaxNLocator

from workbench.core.study import Bars, Curves, Scatter
from workbench.utils.arrays import FloatArray

Drawn: TypeAlias = Curves | Bars | Scatter

INK, GREY, FAINT = "#222222", "#767676", "#C9C9C9"
ESTIMATE, TRUTH = "#D55E00", "#0072B2"
SERIES = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#E69F00", "#56B4E9", "#222222")
"""After Okabe & Ito, distinct for every kind of colour vision; without yellow, which is faint on white paper."""
DASHES = ("-", (0, (5, 2)), (0, (1, 1.5)), "-.", (0, (3, 1, 1, 1, 1, 1)), "-", "-")
"""Line styles of the series in the same order, distinct in print without colours."""
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
_MAX_MARKED = 20  # curves of at most so many points mark them
_SCREEN_DPI, _PICTURE_DPI = 100.0, 150.0  # finer than the view, for zooming


def picture(figure: Drawn, width: float, height: float) -> bytes:
    """Return a figure as a PNG for a view of width × height points of the screen."""
    with context(STYLE):
        drawn = plt.Figure(figsize=(width / _SCREEN_DPI, height / _SCREEN_DPI), layout="constrained")
        draw(drawn.add_subplot(), figure)
        return png(drawn, dpi=_PICTURE_DPI)


def png(drawn: plt.Figure, **options: Any) -> bytes:
    """Return a drawing as a PNG, deterministically; options: of matplotlib's savefig."""
    file = BytesIO()
    drawn.savefig(file, format="png", metadata={"Software": None}, **options)
    return file.getvalue()


def draw(axes: Axes, figure: Drawn) -> None:
    """Draw any of a study's flat figures."""
    match figure:
        case Curves():
            draw_curves(axes, figure)
        case Bars():
            draw_bars(axes, figure)
        case Scatter():
            _draw_scatter(axes, figure)


def draw_curves(axes: Axes, figure: Curves, dashed: bool = False, labels: bool = True, marks_at: float = 1.0) -> None:
    """Draw curves with labels at their right ends, faint ones in grey behind them, and marks as labelled vertical
    lines.

    Parameters
    ----------
    axes, figure : the axes to draw into, and the curves.
    dashed : use different line styles.
    labels : label the curves.
    marks_at : height of the first mark's label, a fraction of the axes'.
    """
    for curve in figure.faint.values():
        axes.plot(figure.x, curve, color=FAINT, linewidth=0.4, zorder=1)
    ends = []
    for k, (label, curve) in enumerate(figure.curves.items()):
        valid, colour = np.isfinite(curve), SERIES[k % len(SERIES)]
        has_neighbor = np.append(False, valid[:-1]) | np.append(valid[1:], False)
        dots = np.flatnonzero(valid & (~has_neighbor | (valid.sum() <= _MAX_MARKED)))
        dashes = DASHES[k % len(DASHES)] if dashed else "-"
        axes.plot(
            figure.x, curve, color=colour, linestyle=dashes, zorder=3.0 - 0.01 * k, marker="o", markersize=2.5,
            markevery=dots,
        )  # fmt: skip
        if valid.any():  # right of all curves, also of a shorter one
            ends.append((label, colour, float(figure.x[-1]), float(curve[valid][-1])))
    axes.set_xlabel(figure.x_name)
    axes.set_ylabel(figure.y_name)
    axes.margins(x=0.0)
    if (figure.x == np.round(figure.x)).all():  # counts
        axes.xaxis.set_major_locator(MaxNLocator(integer=True))
    for k, (label, x) in enumerate(figure.marks.items()):
        axes.axvline(x, color=GREY, linewidth=0.8, linestyle=(0, (4, 3)), zorder=2)
        axes.annotate(
            f"{label} {x:.4g}", (x, marks_at - 0.09 * k), (3.0, 0.0), xycoords=("data", "axes fraction"),
            textcoords="offset points", va="top", fontsize=7.5, color=INK, path_effects=[HALO],
        )  # fmt: skip
    if labels:
        label_ends(axes, ends)


def draw_bars(axes: Axes, figure: Bars) -> None:
    """Draw a histogram as a stepped line, and the model as a dashed one, as in paper C."""
    half = 0.5 * float(np.diff(figure.x).min()) if len(figure.x) > 1 else 0.5
    edges = np.append(figure.x - half, figure.x[-1] + half)
    axes.stairs(figure.heights, edges, color=ESTIMATE, fill=True, alpha=0.25)
    axes.stairs(figure.heights, edges, color=ESTIMATE, linewidth=1.1)
    if figure.model is not None:
        axes.plot(figure.x, figure.model, color=INK, linestyle=(0, (4, 2)), linewidth=1.1)
    axes.set_xlabel(figure.x_name)
    axes.set_ylim(bottom=0.0)


def _draw_scatter(axes: Axes, figure: Scatter) -> None:
    """Draw points by label, with a legend above."""
    for k, (label, points) in enumerate(figure.points.items()):
        colour, marker = SERIES[k % len(SERIES)], "o^sD"[k % 4]
        axes.scatter(
            points[:, 0], points[:, 1], s=5.0, marker=marker, color=colour, alpha=0.45, linewidths=0.0, label=label
        )
    axes.legend(
        loc="lower right", bbox_to_anchor=(1.0, 1.0), ncols=len(figure.points), borderaxespad=0.0, frameon=False,
        markerscale=2.0, handletextpad=0.0, columnspacing=0.6, fontsize=7.5,
    )  # fmt: skip
    axes.set_xlabel(figure.x_name)
    axes.set_ylabel(figure.y_name)


def label_ends(axes: Axes, ends: Sequence[tuple[str, Any, float, float]], gap: float = 0.09, size: float = 7.5) -> None:
    """Draw labels (text, colour, x, y) right of lines' ends, shifted minimally to a spacing of `gap`.

    gap: fraction of the axes' height. size: of the font, points. The axes' limits must be set before.
    """
    scale = axes.yaxis.get_transform()
    low, high = scale.transform(axes.get_ylim())
    ordered = sorted(ends, key=lambda end: end[3])
    heights = [float((scale.transform([y])[0] - low) / (high - low)) for _, _, _, y in ordered]
    for (text, colour, x, _), height in zip(ordered, spread(heights, gap), strict=True):
        axes.annotate(
            text, (x, height), (4.0, 0.0), xycoords=("data", "axes fraction"), textcoords="offset points", va="center",
            color=colour, fontsize=size, path_effects=[HALO], annotation_clip=False,
        )  # fmt: skip


def spread(heights: Sequence[float], gap: float) -> FloatArray:
    """Return increasing heights shifted by least squares to a spacing of at least `gap`."""
    steps = gap * np.arange(len(heights))
    return scipy.optimize.isotonic_regression(np.asarray(heights) - steps).x + steps
