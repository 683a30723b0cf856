"""Growth of time with the number of particles, and of time and memory with the length of a clip.

The likelihood is that of image motion, of 12 limbs, N_SAMPLES points a limb and 640×480 px. Steps run on all cores, and
the fastest of some runs counts, by the clock. An exponent is fitted to the upper half of the sizes.
"""

import os
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.style import context
from matplotlib.ticker import FixedLocator, LogLocator, NullLocator, StrMethodFormatter
from tqdm import tqdm

from analysis.benchmarks import tracking, video_fit
from analysis.benchmarks.likelihood import N_SAMPLES, people, scene
from analysis.benchmarks.measuring import fastest_s, machine, peak_gb
from analysis.figures.style import canvas
from workbench.recording.study.drawing import DASHES, GREY, HALO, SERIES, STYLE, label_ends
from workbench.utils.errors import InputError
from workbench.utils.parallel import single_blas_thread

REPEATS = 4
PARTICLES = (100, 1_000, 10_000, 100_000, 1_000_000)
STEP_PARTICLES = (100, 300, 1_000, 3_000, 10_000, 30_000, 100_000)
CUES_PARTICLES = (100, 300, 1_000, 3_000, 10_000, 30_000)
FITTED = (100, 300, 1_000, 3_000, 9_000)
VIDEO_MS = 1e3 / 30.0
_FAR = 1000.0  # sizes that differ by more get a mark at each power of ten, others one at each size


@dataclass(frozen=True)
class Curve:
    """Values (K,) of one quantity, above 0, at K rising sizes, at least two.

    name: the quantity. size: what grows, with its unit. unit: of the values.
    """

    name: str
    size: str
    unit: str
    sizes: tuple[float, ...]
    values: tuple[float, ...]

    @property
    def exponent(self) -> float:
        """Return p of value ∝ size^p: the slope of the logarithms by least squares, over the upper half of the sizes.

        The lower half shows what a call costs whatever its size.
        """
        upper = slice(min(len(self.sizes) // 2, len(self.sizes) - 2), None)
        return float(np.polyfit(np.log(self.sizes[upper]), np.log(self.values[upper]), 1)[0])

    def __str__(self) -> str:
        sizes, values = (" ".join(f"{number:>9.3g}" for number in row) for row in (self.sizes, self.values))
        name = f"{self.name}, {self.unit}"
        return f"{self.size:<44}{sizes}\n{name:<44}{values}   exponent {self.exponent:.2f}"


def particles(
    sizes: Sequence[int] = PARTICLES, step_sizes: Sequence[int] = STEP_PARTICLES,
    cues_sizes: Sequence[int] = CUES_PARTICLES,
) -> list[Curve]:  # fmt: skip
    """Measure the likelihood alone, and the whole step, recorded, of the default experiment and of several cues."""
    rng = np.random.default_rng(0)
    likelihood, before, now = scene(rng, N_SAMPLES)
    poses = [(people(rng, n), people(rng, n)) for n in sizes]
    alone = fastest_s([partial(likelihood.prepare(before, now).evaluate, *each) for each in poses], REPEATS)
    cues = tracking.several_cues()
    whole = [tracking.fastest(n, max(1, min(4, 30_000 // n))).whole for n in tqdm(step_sizes, disable=None)]
    several = [tracking.fastest(n, max(1, min(4, 9_000 // n)), *cues).whole for n in tqdm(cues_sizes, disable=None)]
    return [
        Curve("whole step", "particles", "ms a frame", tuple(step_sizes), tuple(whole)),
        Curve("several cues", "particles", "ms a frame", tuple(cues_sizes), tuple(several)),
        Curve("likelihood alone", "particles", "ms a frame", tuple(sizes), tuple(1e3 * seconds for seconds in alone)),
    ]


def fit_time(sizes: Sequence[int] = FITTED) -> list[Curve]:
    """Measure the fit of a video to 2-D joints over the frames of its clip, by processor time."""

    def ms_per_frame(size: int, n_cameras: int) -> float:
        observations, times_s, _ = video_fit.scene(size, n_cameras)
        (seconds,) = fastest_s([partial(video_fit.fit, observations, times_s)], 1, clock=time.thread_time)
        return 1e3 * seconds / size

    return _over_frames(sizes, "ms a frame", ms_per_frame)


def fit_memory(sizes: Sequence[int] = FITTED) -> list[Curve]:
    """Measure the peak memory of the fit of a video over the frames of its clip."""
    command, environment = ["-m", "analysis.benchmarks.video_fit"], dict(os.environ, OPENBLAS_NUM_THREADS="1")
    return _over_frames(sizes, "GB", lambda size, n: peak_gb([*command, str(size), str(n)], environment))


def _over_frames(sizes: Sequence[int], unit: str, measure: Callable[[int, int], float]) -> list[Curve]:
    names = {1: "1 camera", 4: "4 cameras"}
    values = {n: tuple(measure(size, n) for size in tqdm(sizes, disable=None)) for n in names}
    return [Curve(name, "frames of the clip", unit, tuple(sizes), values[n]) for n, name in names.items()]


MEASURES: Mapping[str, Callable[[], list[Curve]]] = {
    "time_against_particles": particles,
    "fit_time_against_length": fit_time,
    "fit_memory_against_length": fit_memory,
}
"""Functions that measure the curves of a figure."""


def draw(folder: Path) -> None:
    """Measure all curves, print them, and draw them in `folder`; raises InputError if that cannot be written."""
    print(machine())
    for name, measure in MEASURES.items():
        with single_blas_thread():
            curves = measure()
        print("", name, *curves, sep="\n", flush=True)
        try:
            folder.mkdir(parents=True, exist_ok=True)
            with context(STYLE):
                drawn(name, curves).savefig(folder / f"{name}.png")
        except OSError as error:
            raise InputError(f"{folder}: the figure cannot be written: {error}") from None


def drawn(name: str, curves: Sequence[Curve]) -> Figure:
    """Return the figure of curves, labelled at their ends; over particles with the time that a frame of video lasts."""
    law = f"{curves[0].unit.partition(' ')[0]} ∝ sizeᵖ"
    caption = f"{machine().partition(';')[0]}. Exponents p of {law} are fitted to the upper half of the sizes."
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
    """Label ticks with the numbers themselves, on short axes too."""
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
