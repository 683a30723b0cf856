"""Drawings of what studies record: curves, bars, scattered points, stick figures."""

import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection

from analysis.figures.style import DASHES, ESTIMATE, FAINT, GREY, HALO, INK, SERIES, TRUTH, bare, label_ends
from workbench.arrays import FloatArray
from workbench.errors import InputError
from workbench.recording.reader import Run
from workbench.studies.study import Bars, Curves, Figure, Scatter, Sticks

_AZIMUTH_DEG, _ELEVATION_DEG = -60.0, 8.0  # from where stick figures are seen


def figure_named(run: Run, name: str) -> Figure:
    """A study's figure by its name; raises InputError when the recording has no such figure."""
    for figure in run.figures:
        if figure.name == name:
            return figure
    raise InputError(f"{run.path}: no figure {name!r}, it has {', '.join(figure.name for figure in run.figures)}")


def curves_named(run: Run, name: str) -> Curves:
    """The same for curves."""
    found = figure_named(run, name)
    if not isinstance(found, Curves):
        raise InputError(f"{run.path}: {name}: expected curves, found {type(found).__name__}")
    return found


def draw(axes: Axes, figure: Figure) -> None:
    """Draw any of a study's figures."""
    if isinstance(figure, Curves):
        curves(axes, figure)
    elif isinstance(figure, Bars):
        bars(axes, figure)
    elif isinstance(figure, Scatter):
        scatter(axes, figure)
    else:
        sticks(axes, figure)


def curves(axes: Axes, figure: Curves, dashed: bool = False, labels: bool = True, marks_at: float = 1.0) -> None:
    """Curves with labels at their ends, faint ones grey behind them, marks as vertical lines named at that height."""
    for curve in figure.faint.values():
        axes.plot(figure.x, curve, color=FAINT, linewidth=0.4, zorder=1)
    ends = []
    for k, (label, curve) in enumerate(figure.curves.items()):
        known = np.flatnonzero(np.isfinite(curve))
        colour = SERIES[k % len(SERIES)]
        axes.plot(figure.x[known], curve[known], color=colour, linestyle=DASHES[k % 7] if dashed else "-", zorder=3)
        if len(known):
            ends.append((label, colour, float(figure.x[known[-1]]), float(curve[known[-1]])))
    axes.set_xlabel(figure.x_name)
    axes.set_ylabel(figure.y_name)
    axes.margins(x=0.0)
    for k, (label, x) in enumerate(figure.marks.items()):
        axes.axvline(x, color=GREY, linewidth=0.8, linestyle=(0, (4, 3)), zorder=2)
        axes.annotate(
            f"{label} {x:.4g}", (x, marks_at - 0.09 * k), (3.0, 0.0), xycoords=("data", "axes fraction"),
            textcoords="offset points", va="top", fontsize=7.5, color=INK, path_effects=[HALO],
        )  # fmt: skip
    if labels:
        label_ends(axes, ends)


def bars(axes: Axes, figure: Bars) -> None:
    """A histogram as a stepped line, and the model as a dashed one, as in paper C."""
    axes.stairs(figure.heights, _edges(figure.x), color=ESTIMATE, fill=True, alpha=0.25)
    axes.stairs(figure.heights, _edges(figure.x), color=ESTIMATE, linewidth=1.1)
    if figure.model is not None:
        axes.plot(figure.x, figure.model, color=INK, linestyle=(0, (4, 2)), linewidth=1.1)
    axes.set_xlabel(figure.x_name)
    axes.set_ylim(bottom=0.0)


def scatter(axes: Axes, figure: Scatter) -> None:
    """Points by label, the labels above."""
    for k, (label, points) in enumerate(figure.points.items()):
        colour = SERIES[k % len(SERIES)]
        axes.scatter(
            points[:, 0],
            points[:, 1],
            s=5.0,
            marker="o^sD"[k % 4],
            color=colour,
            alpha=0.45,
            linewidths=0.0,
            label=label,
        )
    axes.legend(
        loc="lower right", bbox_to_anchor=(1.0, 1.0), ncols=len(figure.points), borderaxespad=0.0, frameon=False,
        markerscale=2.0, handletextpad=0.0, columnspacing=0.6, fontsize=7.5,
    )  # fmt: skip
    axes.set_xlabel(figure.x_name)
    axes.set_ylabel(figure.y_name)


def sticks(axes: Axes, figure: Sticks) -> None:
    """Stick figures and their trails, from the side; those of shade 1 are what the others compare with."""
    flat = seen(figure.positions, _AZIMUTH_DEG, _ELEVATION_DEG)
    bones = np.flatnonzero(figure.parents >= 0)
    for pose, shade in zip(flat, figure.shades, strict=True):
        lines = np.stack([pose[bones], pose[figure.parents[bones]]], axis=1)
        colour, width = (TRUTH, 1.4) if shade == 1.0 else ((0.2 + 0.6 * float(shade),) * 3, 0.7)
        axes.add_collection(LineCollection(list(lines), colors=[colour], linewidths=width))
    for k, trail in enumerate(figure.trails.values()):
        axes.plot(*seen(trail, _AZIMUTH_DEG, _ELEVATION_DEG).T, color=SERIES[k % len(SERIES)], linewidth=1.1)
    axes.autoscale_view()
    bare(axes)


def seen(points: FloatArray, azimuth_deg: float, elevation_deg: float) -> FloatArray:
    """World points (..., 3), m, as somebody far away at that azimuth and elevation sees them: (..., 2), m, y up."""
    azimuth, elevation = np.radians([azimuth_deg, elevation_deg])
    right = np.array([-np.sin(azimuth), np.cos(azimuth), 0.0])
    away = np.array([np.cos(azimuth) * np.cos(elevation), np.sin(azimuth) * np.cos(elevation), np.sin(elevation)])
    flat: FloatArray = np.stack([points @ right, points @ np.cross(away, right)], axis=-1)
    return flat


def _edges(middles: FloatArray) -> FloatArray:
    half = 0.5 * (middles[1] - middles[0]) if len(middles) > 1 else 0.5
    edges: FloatArray = np.append(middles - half, middles[-1] + half)
    return edges
