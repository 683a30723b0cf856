"""The posterior over frames: marginals as brightness plots, 90 % credible intervals, coefficients, and ranks."""

from collections.abc import Sequence
from typing import Any

import cv2
import numpy as np
import rerun as rr

from workbench.body.angles import unwrap_near
from workbench.body.skeleton import Skeleton
from workbench.core.resampling import systematic_indices
from workbench.core.state_space import StateSpace
from workbench.core.step import Step
from workbench.evaluation.uncertainty.intervals import weighted_quantiles
from workbench.recording.write import styles
from workbench.recording.write.columns import Entities, Row, Rows
from workbench.recording.write.marginals import LOWEST_LOG_MASS, Marginals, histogram
from workbench.utils.arrays import Float32Array, FloatArray

_SHOWN_ANGLES = tuple(
    f"{side}_{angle}_flexion" for angle in ("hip", "knee", "shoulder", "elbow") for side in ("left", "right")
)
"""The joint angles whose posterior is recorded in addition to the state's columns."""
HIDDEN_SLICES = ("fixed", "ahead")
"""Slices of a state that are not recorded: constant parameters, and the memory "ahead" of the implicit prior."""
PARAMETERS, DEGREES = "posterior/parameters", "posterior/degrees"
"""Paths of credible intervals; the second has those of shown angles in degrees instead of radians."""
PICTURES, RANKS = "posterior/pictures", "evaluation/ranks"
PICTURE_SIZE = np.array([320.0, 80.0])
"""A picture's size, points of a view at 1500 × 950, with space for labels."""
_LABEL_ABOVE = 13.0  # points from a label to its point below
_MAX_SHOWN = 4
_QUANTILES, _MAX_SORTED = (0.05, 0.95), 1000
_COEFFICIENTS_SHOWN, _COEFFICIENT_BINS, _RANK_BINS = 3, 32, 10
_EDGES = 4.0 * np.linspace(-1.0, 1.0, _COEFFICIENT_BINS + 1)
_CURVES = {
    "mean": ("estimate", styles.ESTIMATE, 2.5),
    "low": ("5 %", styles.INTERVAL, 1.0),
    "high": ("95 %", styles.INTERVAL, 1.0),
    "truth": ("truth", styles.TRUTH, 1.5),
}
"""Curves of a credible interval (label, colour, width), in drawing order."""


class Posterior:
    """Collects the marginals of the state's columns without HIDDEN_SLICES, and of _SHOWN_ANGLES, frame by frame.

    names, units: of the parameters, the state's columns first.
    """

    def __init__(self, space: StateSpace, skeleton: Skeleton, n_bins: int) -> None:
        angles = [name for name in _SHOWN_ANGLES if name in skeleton.dof_names and name not in space.names]
        slices = [each for group, each in space.slices.items() if group.rpartition(".")[2] in HIDDEN_SLICES]
        hidden = {i for each in slices for i in range(len(space))[each]}
        self._columns = [i for i in range(len(space)) if i not in hidden]
        self.names = (*(space.names[i] for i in self._columns), *angles)
        self.units = (*(space.units[i] for i in self._columns), *["rad"] * len(angles))
        self._varying: tuple[str, ...] = ()  # parameters in which the first particles differ
        self.frames: list[int] = []
        self._truth: list[dict[str, float]] = []  # by frame
        self._skeleton, self._angles = skeleton, [skeleton.dof(name) for name in angles]
        self._marginals = Marginals(len(self.names), n_bins)
        self.coefficients = range(len(space))[space.slices.get("coefficients", slice(0))][:_COEFFICIENTS_SHOWN]
        self._values = np.empty((len(self.names), 0))
        self._interval_paths = [_interval(name, row) for row in ("mean", "low", "high") for name in self.names]

    @property
    def shown_parameters(self) -> tuple[str, ...]:
        """Up to four parameters with a picture each, among those in which the first particles differ.

        Flexion of hips and knees where legs and arms move; else the pose's first moving parameters, such as an arm's.
        """
        names = [name for name in _SHOWN_ANGLES if name in self._varying]
        if len(names) < _MAX_SHOWN:
            names = [name for name in self._skeleton.dof_names if name in self._varying]
        return tuple(names or self._varying)[:_MAX_SHOWN]

    def unit(self, name: str) -> str:
        """Return a parameter's unit."""
        return self.units[self.names.index(name)]

    def add(self, step: Step) -> dict[str, float]:
        """Add one step, and return the numbers of its credible intervals, {entity path: value}.

        Raises ValueError for particles that are not finite, and weights that do not sum to one.
        """
        columns = [step.particles[:, i] for i in self._columns] + [step.poses[:, i] for i in self._angles]
        if self._values.shape[1] != len(step.particles):
            self._values = np.empty((len(columns), len(step.particles)))  # reused, since allocation is slow
        values, weights = np.stack(columns, out=self._values).T, np.exp(step.log_weights)
        if not np.isfinite(values).all() or not abs(weights.sum() - 1.0) < 1e-6:
            raise ValueError(f"frame {step.frame.index}: expected finite particles with normalised weights")
        if not self._varying:
            self._varying = tuple(np.array(self.names)[np.ptp(values, axis=0) > 0.0].tolist()) or self.names
        self._marginals.add(values, weights)
        self.frames.append(step.frame.index)
        ends = [weights @ values, *_interval_ends(values, weights)]
        numbers = dict(zip(self._interval_paths, np.concatenate(ends).tolist(), strict=True))
        true: dict[str, float] = {}
        if (truth := step.frame.truth) is not None and truth.pose is not None:
            true_pose = unwrap_near(truth.pose, step.expected_pose).tolist()
            pose = dict(zip(self._skeleton.dof_names, true_pose, strict=True))
            true = {name: pose[name] for name in self.names if name in pose}
            numbers |= {_interval(name, "truth"): value for name, value in true.items()}
        self._truth.append({name: true[name] for name in self.shown_parameters if name in true})
        angles = [name for name in self.shown_parameters if self.unit(name) == "rad"]
        curves = [(name, row) for name in angles for row in _CURVES if _interval(name, row) in numbers]
        return numbers | {_interval(*each, DEGREES): float(np.degrees(numbers[_interval(*each)])) for each in curves}

    def begin(self, step: Step) -> Entities:
        """Yield static entities at the first step: styles of the shown curves, bins and models of coefficients.

        Coefficients are in standard deviations of the prior's Gaussian model; the bins reach to four of them.
        """
        for name in self.shown_parameters:
            has_truth = name in self._skeleton.dof_names
            for row in [*_CURVES] if has_truth else [*_CURVES][:3]:
                for root in (PARAMETERS, DEGREES)[: 1 + (self.unit(name) == "rad")]:
                    yield _interval(name, row, root), styles.line(*_CURVES[row])
        density = np.exp(-0.5 * ((_EDGES[1:] + _EDGES[:-1]) / 2.0) ** 2)
        for k in range(1, len(self.coefficients) + 1):
            empty = rr.BarChart(np.zeros(_COEFFICIENT_BINS), **_bars(1.0), color=styles.ESTIMATE)
            values = rr.BarChart.descriptor_values()  # static values would replace those of every frame
            yield f"coefficients/{k}", [b for b in empty.as_component_batches() if b.component_descriptor() != values]
            model = rr.BarChart(density / density.sum(), **_bars(0.25), color=styles.MODEL)
            yield f"coefficients/{k}/model", model

    def histograms(self, step: Step) -> Rows:
        """Yield the samples' weights in the bins of the coefficients k = 1, 2, 3."""
        weights = np.exp(step.log_weights)
        for k, column in enumerate(self.coefficients, start=1):
            heights = histogram(step.particles[:, column], weights, _EDGES)
            yield f"coefficients/{k}", Row(rr.BarChart, {"values": heights})

    def pictures(self) -> tuple[Entities, dict[str, Any]]:
        """Return the marginals so far, [parameter, bin, frame] log mass, and their axes.

        A column that is the mean of several frames has the number of the last of them.
        """
        low, high, log_mass = self._marginals.picture()
        last = [*range(self._marginals.every - 1, len(self.frames), self._marginals.every)]
        frames = [self.frames[i] for i in sorted({*last, len(self.frames) - 1})]
        axes = {"names": self.names, "units": self.units, "low": low, "high": high, "frames": frames}
        lines = ["| parameter | name | lower | upper | unit |", "| ---: | --- | ---: | ---: | --- |"]
        for k, (name, a, b, unit) in enumerate(zip(self.names, low, high, self.units, strict=True)):
            factor, shown_unit = (np.degrees(1.0), "degrees") if unit == "rad" else (1.0, unit)
            lines.append(f"| {k} | {name} | {factor * a:.3g} | {factor * b:.3g} | {shown_unit} |")
        data = rr.encodings.TensorData(  # without a copy
            shape=log_mass.shape, buffer=log_mass.reshape(-1), dim_names=("parameter", "bin", "frame")
        )
        tensor = rr.Tensor(data, value_range=(LOWEST_LOG_MASS, 0.0))
        legend = rr.TextDocument("\n".join(lines), media_type="text/markdown")
        drawn: list[tuple[str, Any]] = []
        for name in self.shown_parameters:
            k, truth = self.names.index(name), np.array([each.get(name, np.nan) for each in self._truth])
            axis = (float(low[k]), float(high[k]))
            drawn += marginal_picture(name, self.units[k], axis, log_mass[k], self.frames, truth)
        return iter([("posterior/marginals", tensor), ("posterior/legend", legend), *drawn]), axes


def marginal_picture(
    name: str, unit: str, axis: tuple[float, float], log_mass: Float32Array, frames: list[int], truth: FloatArray
) -> Entities:
    """Yield one parameter's marginal over frames (paper A, fig. 4), to be logged static.

    Parameters
    ----------
    name, unit : of the parameter.
    axis : lower and upper end of the bins, in `unit`.
    log_mass : (B, F) of the bins, drawn as brightness, upwards.
    frames, truth : (F,) numbers, the first and last written below the picture, and true values or NaN.
    """
    path, factor = f"{PICTURES}/{name}", np.degrees(1.0) if unit == "rad" else 1.0
    bright = np.rint(255.0 * (1.0 - log_mass[::-1] / LOWEST_LOG_MASS)).astype(np.uint8)
    _, png = cv2.imencode(".png", cv2.applyColorMap(bright, cv2.COLORMAP_INFERNO))
    yield f"{path}/mass", rr.EncodedImage(contents=png.tobytes(), media_type="image/png")
    scale = [*(PICTURE_SIZE / bright.shape[::-1]), 1.0]
    yield f"{path}/mass", rr.Transform3D(scale=scale)  # it has no effect at a view's origin
    low, high = axis
    across, down = (np.arange(len(truth)) + 0.5) / len(truth), (high - truth) / (high - low)
    inside = np.isfinite(down) & (down >= 0.0) & (down <= 1.0)
    ends = np.flatnonzero(np.diff(np.concatenate([[False], inside, [False]]).astype(np.int8)))
    places = (np.column_stack([across, down]) * PICTURE_SIZE).astype(np.float32)
    strips = [places[a:b] for a, b in zip(ends[::2], ends[1::2], strict=True)]
    blue, thin = [styles.TRUTH], rr.Radius.ui_points(1.25)
    yield f"{path}/truth", rr.LineStrips2D(strips, colors=blue, radii=thin, draw_order=20.0)
    width, height = PICTURE_SIZE
    spots = np.array([[-24.0, 0.0], [-24.0, height], [12.0, height + 14.0], [width - 12.0, height + 14.0]])
    labels = [f"{factor * high:.3g}", f"{factor * low:.3g}", f"#{frames[0]}", f"#{frames[-1]}"]
    grey, none = [styles.MODEL], rr.Radius.ui_points(0.0)
    spots -= [0.0, _LABEL_ABOVE]
    yield f"{path}/values", rr.Points2D(spots, labels=labels, show_labels=True, colors=grey, radii=none)


def rank_pictures(ranks: Sequence[FloatArray]) -> Entities:
    """Yield the histogram of all ranks (k,) of the frames so far, and the uniform one, to be logged static.

    It is flat if calibrated, U-shaped if overconfident, hump-shaped if underconfident, and sloped if biased. Without
    ranks nothing is yielded.
    """
    counts = np.histogram(np.concatenate([np.zeros(0), *ranks]), _RANK_BINS, (0.0, 1.0))[0]
    if not counts.sum():
        return
    left = np.arange(_RANK_BINS) / _RANK_BINS
    wide, thin = np.full(_RANK_BINS, 1.0 / _RANK_BINS), np.full(_RANK_BINS, 0.1 / _RANK_BINS)
    yield RANKS, rr.BarChart(counts / counts.sum(), abscissa=left, widths=wide, color=styles.ESTIMATE)
    uniform = rr.BarChart(wide, abscissa=left + 0.45 / _RANK_BINS, widths=thin, color=styles.MODEL)
    yield f"{RANKS}/uniform", uniform


def _interval_ends(values: FloatArray, weights: FloatArray) -> FloatArray:
    """Return the ends (2, K) of the 90 % credible intervals; of many particles those of a thousand resampled ones.

    This avoids slow sorting. The weight beyond an end is then 5 % with a standard error of at most 0.7 %, √(0.05 · 0.95
    / 1000).
    """
    if len(values) <= _MAX_SORTED:
        return weighted_quantiles(values, weights, _QUANTILES)
    drawn = np.take(values.T, systematic_indices(weights, 0.5, _MAX_SORTED), axis=1)
    ends = [round(level * _MAX_SORTED) - 1 for level in _QUANTILES]
    drawn.partition(ends, axis=1)
    return drawn[:, ends].T


def _interval(name: str, row: str, root: str = PARAMETERS) -> str:
    return f"{root}/{name}/{row}"


def _bars(fill: float) -> dict[str, FloatArray]:
    """Return bars in the middle of their bins, `fill` of a bin wide; the viewer's abscissa is a bar's left edge."""
    bin_width = _EDGES[1] - _EDGES[0]
    left = _EDGES[:-1] + 0.5 * (1.0 - fill) * bin_width
    return {"abscissa": left, "widths": np.full(len(left), fill * bin_width)}
