"""Figures of studies by name, and stick figures in side view."""

import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection

from analysis.figures.style import bare
from workbench.core.study import Curves, Figure, Sticks
from workbench.recording.read.reader import Run
from workbench.recording.study.drawing import TRUTH
from workbench.utils.arrays import FloatArray
from workbench.utils.errors import InputError

AZIMUTH_DEG, ELEVATION_DEG = -60.0, 8.0  # from where stick figures are seen


def figure_named(run: Run, name: str) -> Figure:
    """Return a study's figure by its name; raises InputError when the recording has no such figure."""
    for figure in run.figures:
        if figure.name == name:
            return figure
    raise InputError(f"{run.path}: no figure {name!r}, it has {', '.join(figure.name for figure in run.figures)}")


def curves_named(run: Run, name: str) -> Curves:
    """Return a study's curves by their name; raises InputError as `figure_named`, and for another kind of figure."""
    figure = figure_named(run, name)
    if not isinstance(figure, Curves):
        raise InputError(f"{run.path}: {name}: expected curves, found {type(figure).__name__}")
    return figure


def sticks(axes: Axes, figure: Sticks) -> None:
    """Draw stick figures from the side; those of shade 1 are the reference."""
    flat = projected(figure.positions, AZIMUTH_DEG, ELEVATION_DEG)
    bones = np.flatnonzero(figure.parents >= 0)
    for pose, shade in zip(flat, figure.shades, strict=True):
        lines = np.stack([pose[bones], pose[figure.parents[bones]]], axis=1)
        colour, width = (TRUTH, 1.4) if shade == 1.0 else ((0.2 + 0.6 * float(shade),) * 3, 0.7)
        axes.add_collection(LineCollection(list(lines), colors=[colour], linewidths=width))
    axes.autoscale_view()
    bare(axes)


def projected(points: FloatArray, azimuth_deg: float, elevation_deg: float) -> FloatArray:
    """Return the orthographic projection (..., 2), m, y up, of world points (..., 3), m, towards that azimuth and
    elevation."""
    azimuth, elevation = np.radians([azimuth_deg, elevation_deg])
    right = np.array([-np.sin(azimuth), np.cos(azimuth), 0.0])
    away = np.array([np.cos(azimuth) * np.cos(elevation), np.sin(azimuth) * np.cos(elevation), np.sin(elevation)])
    flat: FloatArray = np.stack([points @ right, points @ np.cross(away, right)], axis=-1)
    return flat
