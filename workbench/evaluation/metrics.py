"""The table of all metrics of a tracked person: the only place that knows their titles, units and meanings.

The recording, the summary, the terminal, lists, reports, checks and the page `docs/recording.md` read it. A new metric
is the code that computes it and a row here; then `python docs/metrics_tables.py` updates the page.
"""

import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np

ERRORS, CALIBRATION, TRACKING, COST = "Errors", "Calibration of the posterior", "Tracking and inference", "Cost"
SECTIONS = (ERRORS, CALIBRATION, TRACKING, COST)
"""Sections of the page, in order."""

_AGGREGATES: Mapping[str, Callable[[Sequence[float]], float]] = {
    "mean": lambda values: float(np.mean(values)),
    "rms": lambda values: float(np.sqrt(np.mean(np.square(values)))),
    "p99": lambda values: float(np.percentile(values, 99.0)),
}
_SUFFIXES = {"_mean": "mean", "_p99": "99th percentile"}


@dataclass(frozen=True)
class Metric:
    """What is known about a metric, or about a family of metrics.

    Parameters
    ----------
    name : in recordings and summaries; `<group>`, `<cue>`, `<joint>` and `<activity>` stand for the word by which the
        members of a family differ.
    title : in plots, tables and sentences, without the unit.
    unit : "" for a number without one. The terminal shows a "fraction" in percent.
    meaning : the definition, in Markdown, for the page.
    section : of the page, one of SECTIONS; the viewer has a tab for CALIBRATION.
    better : "lower", "higher", the value of a calibrated posterior, or "" if the metric is no measure of quality.
    aggregates : how the values of the frames after the first become the run's number: "mean" or "rms"; with an
        underscore, such as "_mean", it is appended to the name. () for a number of the run without values of frames.
    headline : shown first in reports and side by side; checks also compare the errors among them frame by frame.
    terminal : printed at the end of a run.
    short : title of a column, for the metrics that lists of runs have; "" for the others.
    plot : in the viewer, the metric in whose plot it is drawn, "" for a plot of its own, None for none.
    label : in the legend of such a plot.
    """

    name: str
    title: str
    unit: str
    meaning: str
    section: str = ERRORS
    better: str | float = ""
    aggregates: tuple[str, ...] = ("mean",)
    headline: bool = False
    terminal: bool = False
    short: str = ""
    plot: str | None = ""
    label: str = ""

    @property
    def heading(self) -> str:
        """The title with the unit in parentheses."""
        return f"{self.title} ({self.unit})" if self.unit else self.title

    @property
    def run_names(self) -> tuple[str, ...]:
        """Names of the run's numbers."""
        return tuple(self.name + each * each.startswith("_") for each in self.aggregates) or (self.name,)

    def of_run(self, values: Sequence[float]) -> dict[str, float]:
        """Return the run's numbers by name; values: of the frames after the first."""
        numbers = (_AGGREGATES[each.lstrip("_")](values) for each in self.aggregates)
        return dict(zip(self.run_names, numbers, strict=True)) if self.aggregates else {}

    def words(self, value: float, digits: int = 0) -> str:
        """Return the title with a value and its unit, for a sentence."""
        return f"{self.title} {value:.{digits}f} {self.unit}".rstrip()


METRICS = (
    Metric(
        "mpjpe_abs_mm", "absolute MPJPE", "mm", "mean distance of the joints from the true ones in the world frame",
        better="lower", headline=True, terminal=True, short="error, mm", plot="mpjpe_abs_mm", label="expected pose",
    ),
    Metric(
        "mpjpe_mm", "root-aligned MPJPE", "mm",
        "the same after root alignment, which translates the estimated pelvis onto the true one",
        better="lower", headline=True, terminal=True, plot="mpjpe_abs_mm", label="root-aligned",
    ),
    Metric(
        "pa_mpjpe_mm", "Procrustes-aligned MPJPE", "mm",
        "the same after Procrustes alignment by a similarity transform",
        better="lower", terminal=True, plot="mpjpe_abs_mm", label="Procrustes-aligned",
    ),
    Metric(
        "mpjpe_px", "2-D MPJPE", "px",
        "mean distance of the projected joints from the true positions in the original image; for annotated video, "
        "over the visible annotations",
        better="lower", headline=True, terminal=True, short="error, px", plot="mpjpe_px", label="expected pose",
    ),
    Metric(
        "mpjpe_abs_mm_max_weight", "absolute MPJPE, largest weight", "mm",
        "`mpjpe_abs_mm` of the particle with the largest weight instead of the posterior mean",
        better="lower", plot="mpjpe_abs_mm", label="particle of largest weight",
    ),
    Metric(
        "mpjpe_mm_max_weight", "root-aligned MPJPE, largest weight", "mm", "`mpjpe_mm` of that particle",
        better="lower", plot=None,
    ),
    Metric(
        "mpjpe_px_max_weight", "2-D MPJPE, largest weight", "px", "`mpjpe_px` of that particle",
        better="lower", plot="mpjpe_px", label="particle of largest weight",
    ),
    Metric(
        "mpjae_local_deg", "local MPJAE", "degrees",
        "mean rotation angle between the joint frames and the true ones, relative to their parents", better="lower",
    ),
    Metric(
        "acceleration_error_m_s2", "acceleration error", "m/s²",
        "error of the joints' accelerations, a measure of jitter", better="lower",
    ),
    Metric(
        "humaneva_mm", "HumanEva error in 3-D", "mm",
        "HumanEva's 3-D error, over 15 joints, of its virtual markers where the dataset is HumanEva", better="lower",
    ),
    Metric(
        "humaneva_px", "HumanEva error in 2-D", "px", "the same in 2-D, over 15 joints in all views", better="lower",
    ),
    Metric(
        "humaneva_std_mm", "HumanEva error in 3-D, deviation", "mm",
        "standard deviation of `humaneva_mm` over the frames of HumanEva", aggregates=(),
    ),
    Metric("pck_abs_150mm", "PCK at 150 mm", "fraction", "joints within 15 cm of the true ones", better="higher"),
    Metric(
        "knee_flexion_rmse_deg", "knee flexion RMSE", "degrees",
        "root mean square error of the flexion of both knees, over legs and frames",
        better="lower", aggregates=("rms",), terminal=True,
    ),
    Metric(
        "hip_flexion_rmse_deg", "hip flexion RMSE", "degrees",
        "root mean square error of the flexion of both hips, over legs and frames", better="lower", aggregates=("rms",),
    ),
    Metric(
        "activity_accuracy", "activity accuracy", "fraction",
        "frames in which walking or running is classified correctly", better="higher", headline=True,
    ),
    Metric(
        "mpjpe_abs_offset_corrected_mm", "absolute MPJPE, joint offsets corrected", "mm",
        "`mpjpe_abs_mm` after subtracting the constant offset of each joint from its annotation or marker, the median "
        "over all frames; such an offset may be due to the definition of the joint",
        better="lower", aggregates=(),
    ),
    Metric(
        "mpjpe_offset_corrected_mm", "root-aligned MPJPE, joint offsets corrected", "mm",
        "`mpjpe_mm` with the same correction", better="lower", aggregates=(),
    ),
    Metric(
        "mpjpe_abs_marker_corrected_mm", "absolute MPJPE, marker offsets corrected", "mm",
        "`mpjpe_abs_mm` after subtracting the constant offset of each marker from its joint, estimated once in the "
        "first half second in which the marker is observed; this half second does not count",
        better="lower", plot="mpjpe_abs_mm", label="marker offsets corrected",
    ),
    Metric("marker_offset_<joint>_mm", "offset of the marker", "mm", "length of that offset", aggregates=()),
    Metric(
        "expected_error_<group>_mm", "error expected by the posterior", "mm",
        "predicted error of a joint group: the weighted mean distance of the particles' joints from their mean",
        plot="expected_error_<group>_mm",
    ),
    Metric(
        "mpjpe_abs_<group>_mm", "true error", "mm", "mean distance of the joints of a group from the true ones",
        better="lower", plot="mpjpe_abs_<group>_mm",
    ),
    Metric(
        "coverage_90", "coverage of 90 % intervals", "fraction",
        "pose parameters whose ground truth lies in the 90 % credible interval; a parameter with zero spread and a "
        "wrong value counts as not covered, unless the prior does not move it and its true value stays the initial one",
        CALIBRATION, 0.9, headline=True, terminal=True, short="coverage",
    ),
    Metric("coverage_90_<group>", "coverage of 90 %", "fraction", "the same by part of the body", CALIBRATION, 0.9),
    Metric(
        "coverage_50", "coverage of 50 % intervals", "fraction",
        "the same for the 50 % interval, from the 25 % to the 75 % quantile", CALIBRATION, 0.5,
    ),
    Metric(
        "coverage_90_joints", "joints: coverage of 90 %", "fraction",
        "`coverage_90` over the coordinates of the true joints, where the true pose is unknown",
        CALIBRATION, 0.9, terminal=True,
    ),
    Metric(
        "coverage_90_joints_<group>", "joints: coverage of 90 %", "fraction", "the same by part of the body",
        CALIBRATION, 0.9,
    ),
    Metric(
        "coverage_50_joints", "joints: coverage of 50 %", "fraction",
        "`coverage_50` over the coordinates of the true joints", CALIBRATION, 0.5,
    ),
    Metric(
        "expected_calibration_error", "expected calibration error", "fraction",
        "mean distance of the coverage of the 10, 20 … 90 % intervals from their nominal level",
        CALIBRATION, "lower", aggregates=(),
    ),
    Metric(
        "nees_per_dim", "NEES per dimension", "",
        "mean (truth − mean)² / variance (normalised estimation error squared per dimension)", CALIBRATION, 1.0,
    ),
    Metric(
        "crps_mm", "CRPS, position", "mm",
        "continuous ranked probability score of the posterior of the root's position",
        CALIBRATION, "lower",
    ),
    Metric("crps_deg", "CRPS, angles", "degrees", "the same of the angles", CALIBRATION, "lower"),
    Metric(
        "crps_joints_mm", "CRPS, joints", "mm", "the same of the coordinates of the true joints", CALIBRATION, "lower"
    ),
    Metric(
        "nll", "NLL per parameter", "nats",
        "negative log density of the ground truth under a Gaussian with the posterior's mean and variance, mean over "
        "the parameters; a proper score", CALIBRATION, "lower",
    ),
    Metric(
        "tracked", "tracked throughout", "fraction",
        "1 if, in every five consecutive frames, the mean `mpjpe_px` is below the width of a forearm in the image and "
        "the mean `mpjpe_mm` below 150 mm; without images, if the mean `mpjpe_abs_mm` is below 150 mm; else 0",
        TRACKING, "higher", aggregates=(), headline=True,
    ),
    Metric(
        "forearm_width_px", "width of a forearm in the image", "px", "the threshold of `mpjpe_px` for `tracked`",
        TRACKING, plot="mpjpe_px", label="threshold: a forearm's width",
    ),
    Metric("n_track_losses", "track losses", "", "number of track losses", TRACKING, "lower", aggregates=()),
    Metric(
        "lost_fraction", "frames without track", "fraction", "frames without track", TRACKING, "lower", aggregates=(),
        terminal=True,
    ),
    Metric("n_frames", "frames", "", "number of frames of the run", TRACKING, aggregates=()),
    Metric(
        "ess", "effective sample size", "particles", "effective sample size of the weights", TRACKING, "higher",
        aggregates=("_mean",), terminal=True,
    ),
    Metric(
        "unique_ancestors_lag10", "distinct ancestors 10 frames ago", "particles",
        "distinct ancestors ten frames earlier",
        TRACKING, "higher",
    ),
    Metric(
        "unique_particles", "distinct particles", "particles", "particles with different states", TRACKING, "higher"
    ),
    Metric("acceptance_rate", "acceptance rate", "fraction", "accepted proposals of the MCMC moves", TRACKING),
    Metric("n_temperatures", "temperatures", "", "number of tempering steps of a frame", TRACKING),
    Metric(
        "is_posterior", "particles follow the posterior", "fraction",
        "0 for an annealed filter, whose particles are no sample of the posterior", TRACKING,
    ),
    Metric("lag", "lag", "frames", "later frames that the smoothed estimate of a frame uses", TRACKING),
    Metric("reinitialized", "reinitialized frames", "fraction", "frames in which the filter starts again", TRACKING),
    Metric(
        "inlier_fraction", "observations near the body", "fraction", "observations near the body", TRACKING, "higher",
        terminal=True,
    ),
    Metric("iterations", "iterations", "", "steps of the least-squares solver", TRACKING, "lower"),
    Metric(
        "cost_decrease", "decrease of the cost", "fraction",
        "decrease of the cost in the last ten steps of a least-squares fit that used all its iterations", TRACKING,
        "lower",
    ),
    Metric(
        "variance_fraction_<cue>", "cues' parts of the log-likelihood's variance", "fraction",
        "part of the log likelihood's variance over particles that is due to a cue", TRACKING,
        plot="variance_fraction_<cue>",
    ),
    Metric(
        "probability_<activity>", "probability of the activity", "fraction", "probability of the activity", TRACKING
    ),
    Metric(
        "log_evidence", "log evidence of all frames so far", "nats",
        "log p(all frames) up to a constant, only for a likelihood that is a density of the data "
        "(`likelihood=keypoints likelihood.likelihood_power=1`); otherwise `omitted_metrics` gives the reason",
        TRACKING, "higher", aggregates=(), terminal=True,
    ),
    Metric(
        "jump_deg", "largest change of a joint angle", "degrees",
        "largest change of a joint angle from the previous frame, of a synthesized motion", TRACKING, "lower",
        aggregates=("_mean", "_p99"),
    ),
    Metric(
        "same_activity", "samples from the initial activity", "fraction",
        "frames sampled from recordings of the initial activity, of a synthesized motion", TRACKING, "higher",
    ),
    Metric(
        "seconds", "inference time", "s", "inference time, excluding compilation", COST, "lower", aggregates=(),
        headline=True,
    ),
    Metric("ms_per_frame", "inference time per frame", "ms", "the same for each frame", COST, "lower", aggregates=()),
    Metric("compile_s", "compilation time", "s", "compilation of kernels", COST, "lower", aggregates=()),
    Metric(
        "likelihood_evaluations", "likelihood evaluations", "", "number of likelihood evaluations", COST, "lower",
        aggregates=(), headline=True,
    ),
    Metric(
        "jacobian_cost_ratio", "cost ratio of the Jacobian", "",
        "cost of the residuals with their Jacobian over that of the residuals alone (paper D, section 4.1)",
        COST, "lower", aggregates=(),
    ),
)  # fmt: skip
_ROWS = {row.name: row for row in METRICS}

HEADLINE = tuple(row.name for row in METRICS if row.headline)
"""The metrics that a report shows first."""
HEADLINE_ERRORS = tuple(row.name for row in METRICS if row.headline and row.section == ERRORS and row.better == "lower")
"""The errors of joints among them: runs are ranked by the first one that they have."""
CALIBRATED = {row.name: row.better for row in METRICS if row.headline and isinstance(row.better, float)}
"""The headline metrics with a reference value: that of a calibrated posterior."""
TERMINAL = tuple(name for row in METRICS if row.terminal for name in row.run_names)
"""The numbers of a run that the terminal prints."""
SHORT_TITLES = {row.name: row.short for row in METRICS if row.short}
"""Titles of the columns of lists of runs."""


@lru_cache
def row_of(name: str) -> Metric:
    """Return what is known about a metric, by its name in a recording or a summary, or by that of its row.

    A member of a family has the row of its family with its own name, title and label. A number without a row, such as
    of a user's own component, has its name as the title and no unit.
    """
    if name in _ROWS:
        return _ROWS[name]
    for row in METRICS:
        words = row.name.replace("<group>", "([a-z]+)")
        if match := re.fullmatch(re.sub(r"<\w+>", r"(\\w+)", words), name):
            word = match[1].replace("_", " ")
            return replace(row, name=name, title=f"{word}: {row.title}", label=word)
        if name in row.run_names:
            return replace(row, name=name, title=f"{row.title}, {_SUFFIXES[name.removeprefix(row.name)]}")
    return Metric(name, name.replace("_", " "), "", "")
