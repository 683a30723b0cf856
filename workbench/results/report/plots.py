"""Plots of a report: every run as a dot, means, and 95 % intervals as bands."""

from collections.abc import Callable, Mapping, Sequence
from functools import partial
from typing import Any, NamedTuple

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.axis import Axis
from matplotlib.colors import to_rgb
from matplotlib.figure import Figure
from matplotlib.style import context
from matplotlib.ticker import LogLocator, NullFormatter, NullLocator, StrMethodFormatter
from tqdm import tqdm

from workbench.evaluation.metrics import CALIBRATED, row_of
from workbench.recording.read.reader import Run
from workbench.recording.study.drawing import GREY, INK, SERIES, STYLE, label_ends, png
from workbench.results.report.groups import Grouping, interval, repetitions
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

_Colour = tuple[float, float, float]


class Series(NamedTuple):
    """Groups that differ only in their number of particles, shown in one colour, RGB from 0 to 1.

    label: common settings of the groups. groups: by increasing number of particles.
    """

    label: str
    groups: list[int]
    colour: _Colour

    def shade(self, group: int) -> _Colour:
        """Return the group's colour: the series' for most particles, lighter for fewer."""
        behind = len(self.groups) - 1 - self.groups.index(group)
        return _mixed(self.colour, 1.0, _LIGHTEST * behind / max(len(self.groups) - 1, 1))


class _PlotData(NamedTuple):
    """Data of the plots. errors: see `_errors`, of the metric. more: a sentence on series that are not shown."""

    grouping: Grouping
    metric: str
    errors: pd.DataFrame
    series: list[Series]
    more: str


_Maker = Callable[[_PlotData], Plot | None]


def plots_of(grouping: Grouping) -> list[Plot]:
    """Return the plots of the groups; [] for studies, which track no person."""
    if (metric := grouping.headline) is None:
        return []
    series, n_left_out = all_series(grouping, metric)
    more = f" Shown are the best; {n_left_out} more are in the tables." if n_left_out else ""
    data = _PlotData(grouping, metric, _errors(grouping, metric), series, more)
    with context(_STYLE):
        of_calibration = [partial(_calibration, metric=name) for name in CALIBRATED]
        makers: list[_Maker] = [_against_particles, _against_seconds, *of_calibration, _per_joint]
        plots = [make(data) for make in tqdm(makers, "plots", leave=False, disable=None)]
    return [plot for plot in plots if plot is not None]


def all_series(grouping: Grouping, metric: str) -> tuple[list[Series], int]:
    """Return the series with the smallest `metric`, one for each colour, in the groups' order, and how many others."""
    keys = [key for key in grouping.variation.keys if key != _N_PARTICLES]
    errors = _errors(grouping, metric).sort_values("particles", kind="stable", na_position="first")
    members: dict[str, list[int]] = {}
    for group in sorted(errors.index):
        settings = grouping.settings[group]
        members.setdefault(label(keys, settings) or str(settings[EXPERIMENT]), []).append(group)
    best = sorted(members, key=lambda name: errors["mean"][members[name]].min())[: len(SERIES)]
    best_names = [name for name in members if name in best]
    series = [Series(name, [group for group in errors.index if group in members[name]], to_rgb(colour))
              for name, colour in zip(best_names, SERIES, strict=False)]  # fmt: skip
    return series, len(members) - len(series)


def joint_errors(run: Run) -> Mapping[str, float]:
    """Return every joint's mean error, mm, over the frames with truth after the first, whose pose is given.

    {} for studies and without truth.
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


def _against_particles(data: _PlotData) -> Plot | None:
    lines = _lines(data, "particles")
    if not any(rows["particles"].nunique() > 1 for _, rows in lines):
        return None
    figure, axes = _canvas("Error against particles", "particles", row_of(data.metric).heading)
    axes.set_xscale("log")
    ticks = sorted({count for _, rows in lines for count in rows["particles"]})
    axes.set_xticks(ticks, [f"{count:.0f}" for count in ticks])
    axes.xaxis.set_minor_locator(NullLocator())
    for line, rows in lines:
        axes.fill_between(
            rows["particles"], rows["low_95"], rows["high_95"], color=line.colour, alpha=0.18, linewidth=0.0
        )
        axes.plot(rows["particles"], rows["mean"], color=line.colour, linewidth=2.0, marker="o", markersize=5.0)
        for group, count in rows["particles"].items():
            sample = data.grouping.sample(data.metric, group)["value"]
            axes.plot([count] * len(sample), sample, color=line.colour, **_DOTS)
    _finish(axes, lines, "particles")
    caption = f"Lines are means over people and seeds, bands their 95 % intervals, dots single runs.{data.more}"
    return _plot("error_against_particles", caption, figure)


def _against_seconds(data: _PlotData) -> Plot | None:
    lines = _lines(data, "seconds")
    if not lines:
        return None
    figure, axes = _canvas("Error against time", row_of("seconds").heading, row_of(data.metric).heading)
    axes.set_xscale("log")
    _round_ticks(axes.xaxis)
    for line, rows in lines:
        axes.plot(rows["seconds"], rows["mean"], color=line.colour, linewidth=1.0, alpha=0.5)
        for group, row in rows.iterrows():
            both = data.grouping.sample("seconds", group).merge(
                data.grouping.sample(data.metric, group), on="recording"
            )
            axes.plot(both["value_x"], both["value_y"], color=line.colour, **_DOTS)
            axes.plot([row["seconds"]] * 2, row[["low_95", "high_95"]], color=line.colour, linewidth=7.0, **_BAND)
            axes.plot(row["seconds"], row["mean"], color=line.colour, marker="o", markersize=6.0)
            if len(rows) > 1:
                axes.annotate(
                    f"{row['particles']:.0f}", (row["seconds"], row["mean"]), (0.0, 9.0), textcoords="offset points",
                    ha="center", va="bottom", fontsize=8.0, color=GREY,
                )  # fmt: skip
    left, right = axes.get_xlim()
    if right < 4.0 * left:  # at least a factor of four around the points, so that a logarithmic axis has ticks
        middle = float(np.exp(np.mean(np.log([rows["seconds"].iloc[-1] for _, rows in lines]))))
        axes.set_xlim(min(left, middle / 2.5), max(right, middle * 2.5))
    _finish(axes, lines, "seconds")
    numbered = " Small numbers count particles." if any(len(rows) > 1 for _, rows in lines) else ""
    caption = (
        "Large dots are means over people and seeds, bands the errors' 95 % intervals, small dots single runs. The "
        f"time is that of the inference alone, on the machine that ran it.{numbered}{data.more}"
    )
    return _plot("error_against_time", caption, figure)


def _calibration(data: _PlotData, metric: str) -> Plot | None:
    """Return a plot of a metric with the value of a calibrated posterior."""
    row, level = row_of(metric), CALIBRATED[metric]
    measured = set(data.grouping.values["group"][data.grouping.values["metric"] == metric])
    rows = [(line, group) for line in data.series for group in line.groups if group in measured]
    if not rows:
        return None
    figure, axes = _canvas(row.title.capitalize(), row.heading, "", len(rows))
    axes.axvline(level, color=INK, linewidth=1.0, linestyle=(0, (4, 3)))
    axes.annotate(
        "calibrated", (level, 1.0), (0.0, 3.0), xycoords=("data", "axes fraction"), textcoords="offset points",
        ha="center", va="bottom", fontsize=8.5,
    )  # fmt: skip
    for y, (line, group) in enumerate(rows):
        sample, colour = repetitions(data.grouping.sample(metric, group)), line.shade(group)
        axes.plot(sample, [y] * len(sample), color=_mixed(colour, 0.0, 0.3), **_DOTS)
        _interval_row(axes, y, sample, colour, 9.0)
    axes.set_yticks(range(len(rows)), [data.grouping.labels["group"][group] for _, group in rows])
    axes.set_ylim(len(rows) - 0.5, -0.5)
    if row.unit == "fraction":
        axes.set_xlim(0.0, 1.0)
    caption = (
        "The line is the value of a calibrated posterior; below it the tracker is overconfident. Large dots "
        "are means over people and seeds, bands their 95 % intervals, small dots people, or single runs where there is "
        f"one person.{data.more}"
    )
    return _plot(metric, caption, figure)


def _per_joint(data: _PlotData) -> Plot | None:
    runs = data.grouping.runs.groupby("group")["run"]
    every = [(line, group) for line in data.series for group in line.groups]
    rows = sorted(every, key=lambda row: data.errors["mean"][row[1]])[:_MAX_GROUPS]
    measured = [
        [joint_errors(run) for run in runs.get_group(group)]
        for _, group in tqdm(rows, "joints", unit="group", leave=False, disable=None)
    ]
    names = list(dict.fromkeys(name for group in measured for run in group for name in run))
    if not names:
        return None
    figure, axes = _canvas("Error of each joint", "mean joint error (mm)", "", 1.3 * len(names))
    for y in range(0, len(names), 2):
        axes.axhspan(y - 0.5, y + 0.5, color="#F6F6F6", linewidth=0.0, zorder=0)
    for k, ((line, group), distances) in enumerate(zip(rows, measured, strict=True)):
        offset, colour = 0.8 * ((k + 0.5) / len(rows) - 0.5), line.shade(group)
        for y, name in enumerate(names):
            if sample := [run[name] for run in distances if name in run]:
                _interval_row(axes, y + offset, np.array(sample), colour, min(7.0, 24.0 / len(rows)))
        height = 0.99 - k * 0.05
        axes.text(1.02, height, "●", transform=axes.transAxes, color=colour, va="top")
        axes.text(1.05, height, data.grouping.labels["group"][group], transform=axes.transAxes, va="top")
    axes.set_yticks(range(len(names)), [name.replace("_", " ") for name in names])
    axes.tick_params(axis="y", length=0.0)
    axes.set_ylim(len(names) - 0.5, -0.5)
    axes.set_xlim(left=0.0)
    caption = "Dots are means over frames and runs, bands the 95 % intervals over runs; the best group is on top."
    if len(every) > len(rows):
        caption += f" The {len(every) - len(rows)} groups with larger errors are omitted."
    return _plot("error_per_joint", caption, figure)


def _canvas(title: str, x_name: str, y_name: str, n_rows: float | None = None) -> tuple[Figure, Axes]:
    """Return empty axes: 7 × 4.2 inches, or the height of n_rows of text."""
    figure = Figure(figsize=(7.0, 4.2 if n_rows is None else 1.2 + 0.32 * n_rows), dpi=150)
    axes = figure.add_subplot()
    axes.set_title(title, pad=None if n_rows is None else 22.0)
    axes.set_xlabel(x_name)
    axes.set_ylabel(y_name)
    axes.grid(axis="y" if n_rows is None else "x")
    return figure, axes


def _lines(data: _PlotData, x: str) -> list[tuple[Series, pd.DataFrame]]:
    """Return each series with the rows of its groups with a value in column x."""
    lines = [(line, data.errors.loc[line.groups].dropna(subset=[x])) for line in data.series]
    return [(line, rows) for line, rows in lines if not rows.empty]


def _finish(axes: Axes, lines: Sequence[tuple[Series, pd.DataFrame]], x: str) -> None:
    """Label the lines' ends, and start the error's axis at zero, or make it logarithmic for a wide range of means."""
    means = pd.concat([rows["mean"] for _, rows in lines])
    if means.min() > 0.0 and means.max() > _LOGARITHMIC_FROM * means.min():
        axes.set_yscale("log")
        _round_ticks(axes.yaxis)
    else:
        axes.set_ylim(bottom=0.0)
    ends = [(line.label, _mixed(line.colour, 0.0, 0.25), *rows[[x, "mean"]].iloc[-1]) for line, rows in lines]
    label_ends(axes, ends, _LABEL_GAP, 10.0)


def _round_ticks(axis: Axis) -> None:
    """Set ticks at 1, 2, 5, 10, … of a logarithmic axis."""
    axis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0)))
    axis.set_major_formatter(StrMethodFormatter("{x:g}"))
    axis.set_minor_formatter(NullFormatter())


def _interval_row(axes: Axes, y: float, sample: FloatArray, colour: _Colour, width: float) -> None:
    """Draw mean and interval of a sample in a row."""
    axes.plot(interval(sample), [y, y], color=colour, linewidth=width, **_BAND)
    axes.plot(sample.mean(), y, marker="o", markersize=min(6.5, width), color=colour, markeredgewidth=0.0)


def _errors(grouping: Grouping, metric: str) -> pd.DataFrame:
    """Return the statistics of a metric by group, with the groups' number of particles and mean seconds."""
    by_metric = {name: rows.set_index("group") for name, rows in grouping.statistics.groupby("metric")}
    errors = by_metric[metric]
    particles = [grouping.settings[group].get(_N_PARTICLES) for group in errors.index]
    seconds = by_metric["seconds"]["mean"] if "seconds" in by_metric else np.nan
    return errors.assign(particles=pd.to_numeric(pd.Series(particles, errors.index), errors="coerce"), seconds=seconds)


def _mixed(colour: _Colour, other: float, fraction: float) -> _Colour:
    """Return a colour mixed with a fraction of white (other = 1) or black (0)."""
    red, green, blue = (value + fraction * (other - value) for value in colour)
    return red, green, blue


def _plot(name: str, caption: str, figure: Figure) -> Plot:
    return Plot(name, figure.axes[0].get_title(loc="left"), caption, png(figure, bbox_inches="tight"))
