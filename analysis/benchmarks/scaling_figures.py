"""Drawings of how things grow: curves on logarithmic axes, each with its exponent."""

from collections.abc import Sequence
from pathlib import Path

from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.style import context
from matplotlib.ticker import FixedLocator, LogLocator, NullLocator, StrMethodFormatter

from analysis.benchmarks.curve import Curve
from analysis.benchmarks.machine import cores, processor
from analysis.figures.style import canvas
from workbench.recording.study.drawing import DASHES, GREY, HALO, SERIES, STYLE, label_ends
from workbench.utils.errors import InputError

VIDEO_MS = 1e3 / 30.0
_FAR = 1000.0  # sizes that differ by more get a mark at each power of ten, others one at each size


def write(folder: Path, name: str, curves: Sequence[Curve]) -> None:
    """Draw curves of one size and unit as `folder`/`name`.png; raises InputError where that cannot be written."""
    try:
        folder.mkdir(parents=True, exist_ok=True)
        with context(STYLE):
            drawn(name, curves).savefig(folder / f"{name}.png")
    except OSError as error:
        raise InputError(f"{folder}: the figure cannot be written: {error}") from None


def drawn(name: str, curves: Sequence[Curve]) -> Figure:
    """The curves of one figure, labelled at their ends; over particles with the time that a frame of video lasts."""
    machine, law = f"{processor()}, {cores()} cores", f"{curves[0].unit.partition(' ')[0]} ∝ sizeᵖ"
    caption = f"{machine}. Exponents p of {law} are fitted to the upper half of the sizes."
    figure = canvas(name.replace("_", " ").capitalize(), 3.4, caption)
    axes = figure.subplots()
    axes.set(xscale="log", yscale="log", xlabel=curves[0].size, ylabel=curves[0].unit)
    for curve, colour, dashes in zip(curves, SERIES, DASHES, strict=False):
        axes.plot(curve.sizes, curve.values, color=colour, linestyle=dashes, marker="o", markersize=3.0)
    _tick(axes, curves)
    if name == "time_against_particles":
        axes.axhline(VIDEO_MS, color=GREY, linewidth=0.8, zorder=0)
        axes.annotate(
            "video rate: 33 ms", (0.0, VIDEO_MS), (3.0, 3.0), xycoords=("axes fraction", "data"),
            textcoords="offset points", color=GREY, fontsize=7.5,
        )  # fmt: skip
    _label(axes, curves)
    return figure


def _label(axes: Axes, curves: Sequence[Curve]) -> None:
    """Name every curve: right of its end, or above it where another curve goes on from there."""
    ends, last = [], max(curve.sizes[-1] for curve in curves)
    for curve, colour in zip(curves, SERIES, strict=False):
        text, end = f"{curve.name}\np = {curve.exponent:.2f}", (curve.sizes[-1], curve.values[-1])
        if end[0] == last:
            ends.append((text, colour, *end))
        else:
            axes.annotate(
                text, end, (0.0, 5.0), textcoords="offset points", ha="right", color=colour, fontsize=7.5,
                path_effects=[HALO],
            )  # fmt: skip
    label_ends(axes, ends, gap=0.14)


def _tick(axes: Axes, curves: Sequence[Curve]) -> None:
    """Marks that say the numbers themselves, on short axes too."""
    sizes = curves[0].sizes
    if sizes[-1] < _FAR * sizes[0]:
        axes.xaxis.set_major_locator(FixedLocator(sizes))
        axes.xaxis.set_major_formatter(StrMethodFormatter("{x:.3g}"))
        axes.xaxis.set_minor_locator(NullLocator())
    values = [value for curve in curves for value in curve.values]
    if max(values) < _FAR * min(values):
        axes.yaxis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0)))
        axes.yaxis.set_major_formatter(StrMethodFormatter("{x:g}"))
        axes.yaxis.set_minor_locator(NullLocator())
