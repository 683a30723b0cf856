"""The report's plots: every run as a dot, means, and 95 % intervals as bands."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from matplotlib.axes import Axes
from matplotlib.axis import Axis
from matplotlib.colors import to_rgb
from matplotlib.figure import Figure
from matplotlib.style import context
from matplotlib.ticker import LogLocator, NullFormatter, NullLocator, StrMethodFormatter
from tqdm import tqdm

from workbench.evaluation.headline import TITLES
from workbench.recording.study.drawing import GREY, INK, SERIES, STYLE, label_ends, png
from workbench.results.report.groups import (
    Group,
    Grouping,
    headline,
    interval,
    joint_errors,
    repetitions,
    statistic,
    values,
)
from workbench.results.report.page import Picture
from workbench.results.report.variation import label
from workbench.utils.arrays import FloatArray

_STYLE = STYLE | {
    "font.size": 10.0, "axes.titlesize": 12.0, "axes.labelsize": 10.0, "xtick.labelsize": 10.0, "ytick.labelsize": 10.0,
    "axes.titleweight": "bold", "axes.titlepad": 14.0, "grid.color": "#E4E4E4", "axes.axisbelow": True,
}  # fmt: skip
_LABEL_GAP = 0.06  # of the axes' height
_FAR_APART = 4.0
_MOST_GROUPS = 8  # per joint: more bands on a line hide each other
_LIGHTEST = 0.55
_N_PARTICLES = "inference.n_particles"

Colour = tuple[float, float, float]


@dataclass(frozen=True, eq=False)
class Series:
    """Groups that differ only in their number of particles, shown in one colour, RGB from 0 to 1.

    label: what the groups have in common. groups: by rising number of particles.
    """

    label: str
    groups: tuple[Group, ...]
    colour: Colour

    def shade(self, group: Group) -> Colour:
        """Return the group's own colour: the series' for most particles, lighter for fewer."""
        behind = len(self.groups) - 1 - self.groups.index(group)
        return _mixed(self.colour, 1.0, _LIGHTEST * behind / max(len(self.groups) - 1, 1))


def pictures(grouping: Grouping) -> list[Picture]:
    """Draw the plots that these groups allow: none of studies, which track nobody."""
    metric = headline(grouping.groups)
    if metric is None:
        return []
    with context(_STYLE):
        makers = tqdm((_against_particles, _against_seconds, _coverage, _per_joint), "plots", leave=False, disable=None)
        made = [make(grouping, metric) for make in makers]
    return [picture for picture in made if picture is not None]


def all_series(grouping: Grouping, metric: str) -> tuple[list[Series], int]:
    """Return the series with the least `metric`, one for each colour, in the groups' order; and how many more exist.

    Groups without the metric are in none.
    """
    keys = [key for key in grouping.variation.keys if key != _N_PARTICLES]
    members: dict[str, list[Group]] = {}
    for group in grouping.groups:
        if statistic(group, metric) is not None:
            name = label(keys, group.values) or str(group.settings["experiment"])
            members.setdefault(name, []).append(group)
    best = sorted(members, key=lambda name: min(_mean(group, metric) for group in members[name]))[: len(SERIES)]
    shown = [name for name in members if name in best]
    series = [
        Series(name, tuple(sorted(members[name], key=_n_particles)), to_rgb(colour))
        for name, colour in zip(shown, SERIES, strict=False)
    ]
    return series, len(members) - len(series)


def _against_particles(grouping: Grouping, metric: str) -> Picture | None:
    series, left_out = all_series(grouping, metric)
    counts = sorted({_n_particles(group) for line in series for group in line.groups} - {0.0})
    if not any(len({_n_particles(group) for group in line.groups}) > 1 for line in series):
        return None
    figure, axes = _canvas("Error against particles", "particles", TITLES[metric])
    axes.set_xscale("log")
    axes.set_xticks(counts, [f"{count:.0f}" for count in counts])
    axes.xaxis.set_minor_locator(NullLocator())
    ends = []
    for line in series:
        groups = [group for group in line.groups if _n_particles(group) > 0.0]
        x = np.array([_n_particles(group) for group in groups])
        mean, low, high = _columns(groups, metric)
        axes.fill_between(x, low, high, color=line.colour, alpha=0.18, linewidth=0.0)
        axes.plot(x, mean, color=line.colour, linewidth=2.0, marker="o", markersize=5.0)
        for count, group in zip(x, groups, strict=True):
            sample = [value for _, value in values(group, metric)]
            _dots(axes, np.full(len(sample), count), sample, line.colour)
        ends.append((line.label, line.colour, float(x[-1]), float(mean[-1])))
    _error_axis(axes, [group for line in series for group in line.groups], metric)
    _name_ends(axes, ends)
    caption = "Lines are means over people and seeds, bands their 95 % intervals, dots single runs." + _of_more(
        left_out
    )
    return _picture("error_against_particles", caption, figure)


def _against_seconds(grouping: Grouping, metric: str) -> Picture | None:
    series, left_out = all_series(grouping, metric)
    timed = [line for line in series if any(statistic(group, "seconds") for group in line.groups)]
    if not timed:
        return None
    figure, axes = _canvas("Error against time", TITLES["seconds"], TITLES[metric])
    axes.set_xscale("log")
    _round_ticks(axes.xaxis)
    ends = []
    for line in timed:
        groups = [group for group in line.groups if statistic(group, "seconds")]
        seconds, _, _ = _columns(groups, "seconds")
        mean, low, high = _columns(groups, metric)
        axes.plot(seconds, mean, color=line.colour, linewidth=1.0, alpha=0.5)
        for i, group in enumerate(groups):
            taken = dict(values(group, "seconds"))
            both = np.array([(taken[run], value) for run, value in values(group, metric) if run in taken])
            _dots(axes, both[:, 0], both[:, 1], line.colour)
            _band(axes, [seconds[i]] * 2, [low[i], high[i]], line.colour, 7.0)
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
    _error_axis(axes, [group for line in timed for group in line.groups], metric)
    _name_ends(axes, ends)
    numbered = " Small numbers count particles." if any(len(line.groups) > 1 for line in timed) else ""
    caption = (
        "Large dots are means over people and seeds, bands the errors' 95 % intervals, small dots single runs. The "
        f"time is that of the inference alone, on the machine that ran it.{numbered}{_of_more(left_out)}"
    )
    return _picture("error_against_time", caption, figure)


def _coverage(grouping: Grouping, error: str) -> Picture | None:
    metric, nominal = "coverage_90", 0.9
    series, left_out = all_series(grouping, error)  # as in the other plots, those whose errors are least
    rows = [(line, group) for line in series for group in line.groups if statistic(group, metric) is not None]
    if not rows:
        return None
    figure, axes = _canvas("Coverage of the 90 % band", "fraction of the truth within the band", "", len(rows))
    axes.grid(axis="x")
    axes.axvline(nominal, color=INK, linewidth=1.0, linestyle=(0, (4, 3)))
    axes.annotate(
        "as it should be", (nominal, 1.0), (0.0, 3.0), xycoords=("data", "axes fraction"), textcoords="offset points",
        ha="center", va="bottom", fontsize=8.5,
    )  # fmt: skip
    for y, (line, group) in enumerate(rows):
        _interval_row(axes, float(y), repetitions(values(group, metric)), line.shade(group), 9.0)
    axes.set_yticks(range(len(rows)), [group.label for _, group in rows])
    axes.set_ylim(len(rows) - 0.5, -0.5)
    axes.set_xlim(0.0, 1.0)
    caption = (
        "How often the truth lies in the posterior's 5–95 % band: to the left of the line the tracker is surer than it "
        "should be. Large dots are means over people and seeds, bands their 95 % intervals, small dots people, or "
        "single runs where there is one person."
    )
    return _picture("coverage", caption + _of_more(left_out), figure)


def _per_joint(grouping: Grouping, metric: str) -> Picture | None:
    series, _ = all_series(grouping, metric)
    every = [(line, group) for line in series for group in line.groups]
    rows = sorted(every, key=lambda row: _mean(row[1], metric))[:_MOST_GROUPS]
    measured: dict[Group, dict[str, list[float]]] = {group: {} for _, group in rows}
    for group, samples in tqdm(measured.items(), "joints", unit="group", leave=False, disable=None):
        for run in group.runs:
            for name, error in joint_errors(run).items():
                samples.setdefault(name, []).append(error)
    names = list(dict.fromkeys(name for samples in measured.values() for name in samples))
    if not names:
        return None
    figure, axes = _canvas("Error of each joint", "mean distance from the true joint (mm)", "", 1.3 * len(names))
    axes.grid(axis="x")
    for row in range(0, len(names), 2):
        axes.axhspan(row - 0.5, row + 0.5, color="#F6F6F6", linewidth=0.0, zorder=0)
    for k, (line, group) in enumerate(rows):
        offset = 0.8 * ((k + 0.5) / len(rows) - 0.5)
        for name, sample in measured[group].items():
            y, width = names.index(name) + offset, min(7.0, 24.0 / len(rows))
            _interval_row(axes, y, np.array(sample), line.shade(group), width, single=False)
        height = 0.99 - k * 0.05
        axes.text(1.02, height, "●", transform=axes.transAxes, color=line.shade(group), va="top")
        axes.text(1.05, height, group.label, transform=axes.transAxes, va="top")
    axes.set_yticks(range(len(names)), [name.replace("_", " ") for name in names])
    axes.tick_params(axis="y", length=0.0)
    axes.set_ylim(len(names) - 0.5, -0.5)
    axes.set_xlim(left=0.0)
    caption = "Dots are means over frames and runs, bands the 95 % intervals over runs; the best group is on top."
    if len(every) > len(rows):
        caption += f" The {len(every) - len(rows)} groups with larger errors are left out."
    return _picture("error_per_joint", caption, figure)


def _canvas(title: str, x_name: str, y_name: str, n_rows: float | None = None) -> tuple[Figure, Axes]:
    """Empty axes: 7 × 4.2 inches, or as high as rows of text ask for."""
    figure = Figure(figsize=(7.0, 4.2 if n_rows is None else 1.2 + 0.32 * n_rows), dpi=150)
    axes = figure.add_subplot()
    axes.set_title(title, pad=22.0 if n_rows is not None else None)
    axes.set_xlabel(x_name)
    axes.set_ylabel(y_name)
    if n_rows is None:
        axes.grid(axis="y")
    return figure, axes


def _error_axis(axes: Axes, groups: Sequence[Group], metric: str) -> None:
    """From zero; logarithmic where the groups' errors are so far apart that the small ones would not be told apart."""
    means = [_mean(group, metric) for group in groups]
    if min(means) > 0.0 and max(means) > _FAR_APART * min(means):
        axes.set_yscale("log")
        _round_ticks(axes.yaxis)
    else:
        axes.set_ylim(bottom=0.0)


def _round_ticks(axis: Axis) -> None:
    """Numbers at 1, 2, 5, 10, … of a logarithmic axis."""
    axis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0)))
    axis.set_major_formatter(StrMethodFormatter("{x:g}"))
    axis.set_minor_formatter(NullFormatter())


def _dots(axes: Axes, x: FloatArray, y: Sequence[float] | FloatArray, colour: Colour) -> None:
    axes.plot(x, y, linestyle="none", marker="o", markersize=3.0, color=colour, alpha=0.45, markeredgewidth=0.0)


def _band(axes: Axes, x: Sequence[float], y: Sequence[float], colour: Colour, width: float) -> None:
    """An interval between two points."""
    axes.plot(x, y, color=colour, linewidth=width, alpha=0.3, solid_capstyle="butt")


def _interval_row(axes: Axes, y: float, sample: FloatArray, colour: Colour, width: float, single: bool = True) -> None:
    """Mean and interval of a sample on a line of its own, over its single values."""
    low, high = interval(sample)
    _band(axes, [low, high], [y, y], colour, width)
    if single:
        _dots(axes, sample, np.full(len(sample), y), _mixed(colour, 0.0, 0.3))
    axes.plot(sample.mean(), y, marker="o", markersize=min(6.5, width), color=colour, markeredgewidth=0.0)


def _columns(groups: Sequence[Group], metric: str) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Means, lower and upper ends, one a group; the ends are NaN where there is no interval."""
    each = [statistic(group, metric) for group in groups]
    mean, low, high = np.array([(row.mean, row.low, row.high) if row else (np.nan,) * 3 for row in each]).T
    return mean, low, high


def _mean(group: Group, metric: str) -> float:
    found = statistic(group, metric)
    return np.inf if found is None else found.mean


def _name_ends(axes: Axes, ends: Sequence[tuple[str, Colour, float, float]]) -> None:
    """Labels beside the ends (label, colour, x, y) of lines, in darker colours."""
    label_ends(axes, [(name, _mixed(colour, 0.0, 0.25), x, y) for name, colour, x, y in ends], _LABEL_GAP, 10.0)


def _n_particles(group: Group) -> float:
    """The group's number of particles, 0 where it has none."""
    found = group.settings.get(_N_PARTICLES)
    return float(found) if isinstance(found, int | float) else 0.0


def _mixed(colour: Colour, other: float, part: float) -> Colour:
    """A colour with a part of white (other = 1) or black (0)."""
    red, green, blue = (value + part * (other - value) for value in colour)
    return red, green, blue


def _of_more(left_out: int) -> str:
    return f" Shown are the best; {left_out} more are in the tables." if left_out else ""


def _picture(name: str, caption: str, figure: Figure) -> Picture:
    return Picture(name, figure.axes[0].get_title(loc="left"), caption, png(figure, bbox_inches="tight"))
