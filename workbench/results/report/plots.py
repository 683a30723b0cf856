"""The report's plots: every run as a dot, means, and 95 % intervals as bands."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.axis import Axis
from matplotlib.colors import to_rgb
from matplotlib.figure import Figure
from matplotlib.style import context
from matplotlib.ticker import LogLocator, NullFormatter, NullLocator, StrMethodFormatter
from tqdm import tqdm

from workbench.evaluation.headline import COVERAGE, TITLES
from workbench.recording.read.reader import Run
from workbench.recording.study.drawing import GREY, INK, SERIES, STYLE, label_ends, png
from workbench.results.report.groups import Group, Grouping, headline, interval, repetitions, statistic, values
from workbench.results.report.page import Plot
from workbench.results.report.variation import EXPERIMENT, label
from workbench.utils.arrays import FloatArray

_STYLE = STYLE | {
    "font.size": 10.0, "axes.titlesize": 12.0, "axes.labelsize": 10.0, "xtick.labelsize": 10.0, "ytick.labelsize": 10.0,
    "axes.titleweight": "bold", "axes.titlepad": 14.0, "grid.color": "#E4E4E4", "axes.axisbelow": True,
}  # fmt: skip
_LABEL_GAP = 0.06  # of the axes' height
_LOGARITHMIC_FROM = 4.0  # of the largest mean error to the smallest
_MAX_GROUPS = 8  # per joint: more bands on a line hide each other
_LIGHTEST = 0.55
_N_PARTICLES = "inference.n_particles"
_DOTS: dict[str, Any] = {"linestyle": "none", "marker": "o", "markersize": 3.0, "alpha": 0.45, "markeredgewidth": 0.0}
_BAND: dict[str, Any] = {"alpha": 0.3, "solid_capstyle": "butt"}

Colour = tuple[float, float, float]
End = tuple[str, Colour, float, float]
"""Label, colour, x and y of a line's end."""


@dataclass(frozen=True, eq=False)
class Series:
    """Groups with a metric that differ only in their number of particles, shown in one colour, RGB from 0 to 1.

    label: what the groups have in common. groups: by rising number of particles.
    """

    label: str
    groups: tuple[Group, ...]
    colour: Colour

    def shade(self, group: Group) -> Colour:
        """Return the group's own colour: the series' for most particles, lighter for fewer."""
        behind = len(self.groups) - 1 - self.groups.index(group)
        return _mixed(self.colour, 1.0, _LIGHTEST * behind / max(len(self.groups) - 1, 1))


def plots_of(grouping: Grouping) -> list[Plot]:
    """Draw the plots that these groups allow: none of studies, which track nobody."""
    metric = headline(grouping.groups)
    if metric is None:
        return []
    series, n_left_out = all_series(grouping, metric)
    more = f" Shown are the best; {n_left_out} more are in the tables." if n_left_out else ""
    with context(_STYLE):
        makers = tqdm((_against_particles, _against_seconds, _coverage, _per_joint), "plots", leave=False, disable=None)
        plots = [make(series, metric, more) for make in makers]
    return [plot for plot in plots if plot is not None]


def all_series(grouping: Grouping, metric: str) -> tuple[list[Series], int]:
    """Return the series with the least `metric`, one for each colour, in the groups' order; and how many more exist."""
    keys = [key for key in grouping.variation.keys if key != _N_PARTICLES]
    members: dict[str, list[Group]] = {}
    for group in grouping.groups:
        if not values(group, metric).empty:
            members.setdefault(label(keys, group.values) or str(group.settings[EXPERIMENT]), []).append(group)
    best = sorted(members, key=lambda name: min(_means(members[name], metric)[0]))[: len(SERIES)]
    shown = [name for name in members if name in best]
    series = [Series(name, tuple(sorted(members[name], key=_n_particles)), to_rgb(colour))
              for name, colour in zip(shown, SERIES, strict=False)]  # fmt: skip
    return series, len(members) - len(series)


def joint_errors(run: Run) -> Mapping[str, float]:
    """Return every joint's mean distance from its true place, mm, over the frames after the first that have truth.

    Empty for studies and without truth. The first frame is given, not tracked.
    """
    if run.is_study:
        return {}
    estimate, truth = run.joints, run.true_joints
    frames, ours, theirs = np.intersect1d(estimate.frames, truth.frames, return_indices=True)
    tracked = frames > estimate.frames.min(initial=np.iinfo(np.int64).max)
    if not tracked.any():
        return {}
    errors = estimate.positions[ours[tracked]] - truth.positions[theirs[tracked]]
    means = 1e3 * np.linalg.norm(errors, axis=2).mean(axis=0)
    return dict(zip(estimate.names, means.tolist(), strict=True))


def _against_particles(series: Sequence[Series], metric: str, more: str) -> Plot | None:
    counts = sorted({_n_particles(group) for line in series for group in line.groups} - {0.0})
    if not any(len({_n_particles(group) for group in line.groups}) > 1 for line in series):
        return None
    figure, axes = _canvas("Error against particles", "particles", TITLES[metric])
    axes.set_xscale("log")
    axes.set_xticks(counts, [f"{count:.0f}" for count in counts])
    axes.xaxis.set_minor_locator(NullLocator())
    ends: list[End] = []
    for line in series:
        groups = [group for group in line.groups if _n_particles(group) > 0.0]
        x = [_n_particles(group) for group in groups]
        mean, low, high = _means(groups, metric)
        axes.fill_between(x, low, high, color=line.colour, alpha=0.18, linewidth=0.0)
        axes.plot(x, mean, color=line.colour, linewidth=2.0, marker="o", markersize=5.0)
        for count, group in zip(x, groups, strict=True):
            sample = values(group, metric)
            axes.plot([count] * len(sample), sample, color=line.colour, **_DOTS)
        ends += [(line.label, line.colour, x[-1], float(mean[-1]))] if groups else []
    _finish(axes, series, metric, ends)
    caption = f"Lines are means over people and seeds, bands their 95 % intervals, dots single runs.{more}"
    return _plot("error_against_particles", caption, figure)


def _against_seconds(series: Sequence[Series], metric: str, more: str) -> Plot | None:
    of_line = [(line, [group for group in line.groups if "seconds" in group.numbers]) for line in series]
    timed = [(line, groups) for line, groups in of_line if groups]
    if not timed:
        return None
    figure, axes = _canvas("Error against time", TITLES["seconds"], TITLES[metric])
    axes.set_xscale("log")
    _round_ticks(axes.xaxis)
    ends: list[End] = []
    for line, groups in timed:
        seconds = _means(groups, "seconds")[0]
        mean, low, high = _means(groups, metric)
        axes.plot(seconds, mean, color=line.colour, linewidth=1.0, alpha=0.5)
        for i, group in enumerate(groups):
            both = group.numbers[["seconds", metric]].dropna()
            axes.plot(both["seconds"], both[metric], color=line.colour, **_DOTS)
            axes.plot([seconds[i]] * 2, [low[i], high[i]], color=line.colour, linewidth=7.0, **_BAND)
            axes.plot(seconds[i], mean[i], color=line.colour, marker="o", markersize=6.0)
            if len(groups) > 1:
                axes.annotate(
                    f"{_n_particles(group):.0f}", (seconds[i], mean[i]), (0.0, 9.0), textcoords="offset points",
                    ha="center", va="bottom", fontsize=8.0, color=GREY,
                )  # fmt: skip
        ends.append((line.label, line.colour, float(seconds[-1]), float(mean[-1])))
    left, right = axes.get_xlim()
    if right < 4.0 * left:  # at least a factor of four around the points, so that a logarithmic axis has ticks
        middle = float(np.exp(np.mean(np.log([x for _, _, x, _ in ends]))))
        axes.set_xlim(min(left, middle / 2.5), max(right, middle * 2.5))
    _finish(axes, [line for line, _ in timed], metric, ends)
    numbered = " Small numbers count particles." if any(len(groups) > 1 for _, groups in timed) else ""
    caption = (
        "Large dots are means over people and seeds, bands the errors' 95 % intervals, small dots single runs. The "
        f"time is that of the inference alone, on the machine that ran it.{numbered}{more}"
    )
    return _plot("error_against_time", caption, figure)


def _coverage(series: Sequence[Series], _: str, more: str) -> Plot | None:
    rows = [(line, group) for line in series for group in line.groups if not values(group, COVERAGE).empty]
    if not rows:
        return None
    figure, axes = _canvas("Coverage of the 90 % band", "fraction of the truth within the band", "", len(rows))
    axes.axvline(0.9, color=INK, linewidth=1.0, linestyle=(0, (4, 3)))
    axes.annotate(
        "as it should be", (0.9, 1.0), (0.0, 3.0), xycoords=("data", "axes fraction"), textcoords="offset points",
        ha="center", va="bottom", fontsize=8.5,
    )  # fmt: skip
    for y, (line, group) in enumerate(rows):
        sample, colour = repetitions(values(group, COVERAGE)), line.shade(group)
        axes.plot(sample, [y] * len(sample), color=_mixed(colour, 0.0, 0.3), **_DOTS)
        _interval_row(axes, y, sample, colour, 9.0)
    axes.set_yticks(range(len(rows)), [group.label for _, group in rows])
    axes.set_ylim(len(rows) - 0.5, -0.5)
    axes.set_xlim(0.0, 1.0)
    caption = (
        "How often the truth lies in the posterior's 5–95 % band: to the left of the line the tracker is surer than it "
        "should be. Large dots are means over people and seeds, bands their 95 % intervals, small dots people, or "
        f"single runs where there is one person.{more}"
    )
    return _plot("coverage", caption, figure)


def _per_joint(series: Sequence[Series], metric: str, _: str) -> Plot | None:
    every = [(line, group) for line in series for group in line.groups]
    rows = sorted(every, key=lambda row: _means([row[1]], metric)[0][0])[:_MAX_GROUPS]
    measured = [
        [joint_errors(run) for run in group.runs]
        for _, group in tqdm(rows, "joints", unit="group", leave=False, disable=None)
    ]
    names = list(dict.fromkeys(name for group in measured for run in group for name in run))
    if not names:
        return None
    figure, axes = _canvas("Error of each joint", "mean distance from the true joint (mm)", "", 1.3 * len(names))
    for y in range(0, len(names), 2):
        axes.axhspan(y - 0.5, y + 0.5, color="#F6F6F6", linewidth=0.0, zorder=0)
    for k, ((line, group), runs) in enumerate(zip(rows, measured, strict=True)):
        offset, colour = 0.8 * ((k + 0.5) / len(rows) - 0.5), line.shade(group)
        for y, name in enumerate(names):
            if sample := [run[name] for run in runs if name in run]:
                _interval_row(axes, y + offset, np.array(sample), colour, min(7.0, 24.0 / len(rows)))
        height = 0.99 - k * 0.05
        axes.text(1.02, height, "●", transform=axes.transAxes, color=colour, va="top")
        axes.text(1.05, height, group.label, transform=axes.transAxes, va="top")
    axes.set_yticks(range(len(names)), [name.replace("_", " ") for name in names])
    axes.tick_params(axis="y", length=0.0)
    axes.set_ylim(len(names) - 0.5, -0.5)
    axes.set_xlim(left=0.0)
    caption = "Dots are means over frames and runs, bands the 95 % intervals over runs; the best group is on top."
    if len(every) > len(rows):
        caption += f" The {len(every) - len(rows)} groups with larger errors are left out."
    return _plot("error_per_joint", caption, figure)


def _canvas(title: str, x_name: str, y_name: str, n_rows: float | None = None) -> tuple[Figure, Axes]:
    """Return empty axes: 7 × 4.2 inches, or as high as n_rows of text need."""
    figure = Figure(figsize=(7.0, 4.2 if n_rows is None else 1.2 + 0.32 * n_rows), dpi=150)
    axes = figure.add_subplot()
    axes.set_title(title, pad=None if n_rows is None else 22.0)
    axes.set_xlabel(x_name)
    axes.set_ylabel(y_name)
    axes.grid(axis="y" if n_rows is None else "x")
    return figure, axes


def _finish(axes: Axes, series: Sequence[Series], metric: str, ends: Sequence[End]) -> None:
    """Label the lines' ends, and begin the error's axis at zero, or make it logarithmic where errors differ much."""
    means = np.concatenate([_means(line.groups, metric)[0] for line in series])
    if means.min() > 0.0 and means.max() > _LOGARITHMIC_FROM * means.min():
        axes.set_yscale("log")
        _round_ticks(axes.yaxis)
    else:
        axes.set_ylim(bottom=0.0)
    label_ends(axes, [(name, _mixed(colour, 0.0, 0.25), x, y) for name, colour, x, y in ends], _LABEL_GAP, 10.0)


def _round_ticks(axis: Axis) -> None:
    """Put numbers at 1, 2, 5, 10, … of a logarithmic axis."""
    axis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0)))
    axis.set_major_formatter(StrMethodFormatter("{x:g}"))
    axis.set_minor_formatter(NullFormatter())


def _interval_row(axes: Axes, y: float, sample: FloatArray, colour: Colour, width: float) -> None:
    """Draw mean and interval of a sample on a line of its own."""
    axes.plot(interval(sample), [y, y], color=colour, linewidth=width, **_BAND)
    axes.plot(sample.mean(), y, marker="o", markersize=min(6.5, width), color=colour, markeredgewidth=0.0)


def _means(groups: Sequence[Group], metric: str) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return means, lower and upper ends (G,) of groups that have the metric; ends are NaN without an interval."""
    each = [statistic(group, metric) for group in groups]
    mean, low, high = np.array([(row.mean, row.low, row.high) if row else (np.nan,) * 3 for row in each]).T
    return mean, low, high


def _n_particles(group: Group) -> float:
    """Return the group's number of particles, 0 where it has none."""
    n = group.settings.get(_N_PARTICLES)
    return float(n) if isinstance(n, int | float) else 0.0


def _mixed(colour: Colour, other: float, part: float) -> Colour:
    """Return a colour with a part of white (other = 1) or black (0)."""
    red, green, blue = (value + part * (other - value) for value in colour)
    return red, green, blue


def _plot(name: str, caption: str, figure: Figure) -> Plot:
    return Plot(name, figure.axes[0].get_title(loc="left"), caption, png(figure, bbox_inches="tight"))
