"""The posterior over frames: marginals as brightness plots, 5–95 % bands, coefficients, and the ranks of the truth."""

from collections.abc import Iterable
from typing import Any

import numpy as np
import rerun as rr
import rerun.blueprint as rrb

from workbench.body.angles import nearest_turn
from workbench.body.skeleton import Skeleton
from workbench.core.resampling import systematic_indices
from workbench.core.state_space import StateSpace
from workbench.core.step import Step
from workbench.evaluation.intervals import weighted_quantiles
from workbench.evaluation.posterior_calibration import rank_histogram
from workbench.evaluation.step_calibration import pose_ranks
from workbench.recording.write import colours, marginal_pictures
from workbench.recording.write.columns import Entities, Row, Rows
from workbench.recording.write.marginals import LOWEST_LOG_MASS, Marginals, histogram
from workbench.utils.arrays import Float32Array, FloatArray

SHOWN_ANGLES = tuple(
    f"{side}_{angle}_flexion" for angle in ("hip", "knee", "shoulder", "elbow") for side in ("left", "right")
)
"""The joint angles whose posterior is recorded beside that of the state's columns."""
UNSEEN = ("held", "ahead")
"""Slices of a state whose columns nobody estimates: held parameters never change, "ahead" is the implicit's memory."""
_FAVOURITES = 4
_BAND, _BAND_ROWS = (0.05, 0.95), ("mean", "low", "high")
_MOST_SORTED = 1000
_COEFFICIENTS_SHOWN = 3
_COEFFICIENT_BINS = 32
RANKS = "evaluation/ranks"
_RANK_BINS = 10
PARAMETERS, DEGREES = "posterior/parameters", "posterior/degrees"
"""The bands of favourites that are angles, to be looked at; `posterior/parameters` has them in radians."""
_CURVES = (  # row, name in the viewer, colour, width
    ("mean", "estimate", colours.ESTIMATE, 2.5),
    ("low", "5 %", colours.BAND, 1.0),
    ("high", "95 %", colours.BAND, 1.0),
    ("truth", "truth", colours.TRUTH, 1.5),
)


class Posterior:
    """Collects the marginals of the state's columns, but those of UNSEEN slices, and of SHOWN_ANGLES, frame by frame.

    names, units: one per parameter, the state's columns first.
    """

    def __init__(self, space: StateSpace, skeleton: Skeleton, scale: FloatArray | None, n_bins: int) -> None:
        angles = [name for name in SHOWN_ANGLES if name in skeleton.dof_names and name not in space.names]
        unseen = [part for group, part in space.slices.items() if group.rpartition(".")[2] in UNSEEN]
        hidden = {i for part in unseen for i in range(len(space))[part]}  # also of a mixture's "<prior>.held"
        self._columns = [i for i in range(len(space)) if i not in hidden]
        self.names = (*(space.names[i] for i in self._columns), *angles)
        self.units = (*(space.units[i] for i in self._columns), *["rad"] * len(angles))
        self._varying = self.names  # of the first particles, once they are known
        self._began = False
        self.frames: list[int] = []
        self._truth: list[dict[str, float]] = []  # by frame
        self._skeleton, self._angles = skeleton, [skeleton.dof(name) for name in angles]
        self._marginals = Marginals(len(self.names), n_bins)
        self.coefficients = range(len(space))[space.slices.get("coefficients", slice(0))][:_COEFFICIENTS_SHOWN]
        self._scale, self._edges = scale, list[FloatArray]()
        self._kept = np.empty((len(self.names), 0))
        self._band_paths = [_band(name, row) for row in _BAND_ROWS for name in self.names]

    @property
    def favourites(self) -> tuple[str, ...]:
        """Name up to four parameters worth a picture of their own, of those in which the first particles differ.

        Flexion of hips and knees where legs and arms move; else the pose's first moving parameters, such as an arm's.
        """
        shown = [name for name in SHOWN_ANGLES if name in self._varying]
        if len(shown) < _FAVOURITES:
            shown = [name for name in self._skeleton.dof_names if name in self._varying]
        return tuple(shown or self._varying)[:_FAVOURITES]

    def add(self, step: Step) -> dict[str, float]:
        """Take one step in; returns the numbers of its bands, {entity path: value}."""
        values = self._values(step)
        weights = np.exp(step.log_weights)
        if not np.isfinite(values).all() or not abs(weights.sum() - 1.0) < 1e-6:
            raise ValueError(f"frame {step.frame.index}: particles must be finite and their weights sum to one")
        if not self._began and (differ := np.ptp(values, axis=0) > 0.0).any():
            self._varying = tuple(np.array(self.names)[differ].tolist())
        self._began = True
        self._marginals.add(values, weights)
        self.frames.append(step.frame.index)
        ends = [weights @ values, *_band_ends(values, weights)]
        numbers = dict(zip(self._band_paths, np.concatenate(ends).tolist(), strict=True))
        true: dict[str, float] = {}
        if (known := step.frame.truth) is not None and known.pose is not None:
            dofs, pose = self._skeleton.dof_names, nearest_turn(known.pose, step.expected_pose)
            true = {name: float(pose[dofs.index(name)]) for name in self.names if name in dofs}
            numbers |= {_band(name, "truth"): value for name, value in true.items()}
        self._truth.append({name: true[name] for name in self.favourites if name in true})
        angles = [name for name in self.favourites if self.unit(name) == "rad"]
        bands = [(name, row) for name in angles for row, *_ in _CURVES if _band(name, row) in numbers]
        return numbers | {_band(*each, DEGREES): float(np.degrees(numbers[_band(*each)])) for each in bands}

    def unit(self, name: str) -> str:
        """Return a parameter's unit."""
        return self.units[self.names.index(name)]

    def _values(self, step: Step) -> FloatArray:
        """Return the parameters (N, K) of the particles, column by column, in memory that the next step overwrites."""
        columns = [step.particles[:, i] for i in self._columns] + [step.poses[:, i] for i in self._angles]
        if self._kept.shape[1] != len(step.particles):
            self._kept = np.empty((len(columns), len(step.particles)))  # new memory each time takes longer than copying
        return np.stack(columns, out=self._kept).T

    def take_over(self, frames: Iterable[int], low: FloatArray, high: FloatArray, log_mass: FloatArray) -> None:
        """Begin with frames whose marginals were `pictures`."""
        told = [*frames]
        self.frames += told[: self._marginals.take_over(low, high, log_mass, len(told))]
        self._truth = [{} for _ in self.frames]  # not drawn over their marginals

    def begin(self, step: Step) -> Entities:
        """Yield what stays as the first step finds it: styles of favourites' curves, bins and models of coefficients.

        The bins reach to four standard deviations of the model, or without one to twice the first step's samples.
        """
        lines = {
            row: rr.SeriesLines(colors=[colour], widths=[width], names=[label]) for row, label, colour, width in _CURVES
        }
        for name in self.favourites:
            known = name in self._skeleton.dof_names  # else there is no truth to compare with
            for row in [*lines] if known else [*lines][:3]:
                for root in (PARAMETERS, DEGREES)[: 1 + (self.unit(name) == "rad")]:
                    yield _band(name, row, root), lines[row]
        for k, column in enumerate(self.coefficients, start=1):
            samples = step.particles[:, column]
            reach = 2.0 * np.abs(samples).max() if self._scale is None else 4.0 * self._scale[k - 1]
            edges = max(float(reach), 1e-6) * np.linspace(-1.0, 1.0, _COEFFICIENT_BINS + 1)
            self._edges.append(edges)
            empty = rr.BarChart(np.zeros(_COEFFICIENT_BINS), **_bars(edges, 1.0), color=colours.ESTIMATE)
            values = rr.BarChart.descriptor_values()  # static ones would stand for those of every frame
            yield f"coefficients/{k}", [b for b in empty.as_component_batches() if b.component_descriptor() != values]
            if self._scale is not None:
                density = np.exp(-0.5 * ((edges[1:] + edges[:-1]) / (2.0 * self._scale[k - 1])) ** 2)
                model = rr.BarChart(density / density.sum(), **_bars(edges, 0.25), color=colours.MODEL)
                yield f"coefficients/{k}/model", model

    def histograms(self, step: Step) -> Rows:
        """Yield the weights of the samples in the bins of each coefficient, k = 1, 2, 3 as the papers count."""
        weights = np.exp(step.log_weights)
        for k, (column, edges) in enumerate(zip(self.coefficients, self._edges, strict=True), start=1):
            heights = histogram(step.particles[:, column], weights, edges)
            yield f"coefficients/{k}", Row(rr.BarChart, {"values": heights})

    def pictures(self) -> tuple[Entities, dict[str, Any]]:
        """Return the marginals so far, [parameter, bin, frame] log mass, and what their axes stand for; where a column
        is the mean of several frames, it is called by the last of them."""
        low, high, log_mass = self._marginals.picture()
        last = [*range(self._marginals.every - 1, len(self.frames), self._marginals.every)]
        frames = [self.frames[i] for i in sorted({*last, len(self.frames) - 1})]
        axes = {"names": self.names, "units": self.units, "low": low, "high": high, "frames": frames}
        lines = ["| parameter | name | lowest | highest | unit |", "| ---: | --- | ---: | ---: | --- |"]
        for k, (name, a, b, unit) in enumerate(zip(self.names, low, high, self.units, strict=True)):
            factor, shown = (np.degrees(1.0), "degrees") if unit == "rad" else (1.0, unit)
            lines.append(f"| {k} | {name} | {factor * a:.3g} | {factor * b:.3g} | {shown} |")
        dim_names, value_range = ("parameter", "bin", "frame"), (LOWEST_LOG_MASS, 0.0)
        tensor = rr.Tensor(log_mass, dim_names=dim_names, value_range=value_range)
        legend = rr.TextDocument("\n".join(lines), media_type="text/markdown")
        drawn = [each for name in self.favourites for each in self._picture(name, low, high, log_mass)]
        return iter([("posterior/marginals", tensor), ("posterior/legend", legend), *drawn]), axes

    def _picture(self, name: str, low: FloatArray, high: FloatArray, log_mass: Float32Array) -> Entities:
        k, truth = self.names.index(name), np.array([each.get(name, np.nan) for each in self._truth])
        axis = (float(low[k]), float(high[k]))
        return marginal_pictures.entities(name, self.units[k], axis, log_mass[k], self.frames, truth)


class Ranks:
    """Counts the ranks of the true pose's numbers, frame by frame; not of the first frame, which is given."""

    def __init__(self) -> None:
        self._counts = np.zeros(_RANK_BINS, dtype=np.int64)
        self._uncounted: list[FloatArray] = []
        self._began = False

    def add(self, step: Step) -> FloatArray:
        """Take one step in; returns the ranks (k,) that count."""
        ranks = pose_ranks(step) if self._began else np.zeros(0)
        self.take_over(ranks)
        return ranks

    def take_over(self, ranks: FloatArray) -> None:
        """Count the ranks (k,) of a frame."""
        self._uncounted.append(ranks)
        self._began = True

    def pictures(self) -> Entities:
        """Yield each tenth's share of all ranks so far, to be logged static, before even ones; without truth none."""
        if self._uncounted:  # all at once, as most of the time goes into calling NumPy
            self._counts += rank_histogram(np.concatenate(self._uncounted), _RANK_BINS)
            self._uncounted.clear()
        if (total := self._counts.sum()) == 0:
            return
        left = np.arange(_RANK_BINS) / _RANK_BINS
        wide, thin = np.full(_RANK_BINS, 1.0 / _RANK_BINS), np.full(_RANK_BINS, 0.1 / _RANK_BINS)
        yield RANKS, rr.BarChart(self._counts / total, abscissa=left, widths=wide, color=colours.ESTIMATE)
        even = rr.BarChart(wide, abscissa=left + 0.45 / _RANK_BINS, widths=thin, color=colours.MODEL)
        yield f"{RANKS}/even", even


def ranks_view() -> rrb.BarChartView:
    """Lay out the bars."""
    name = "ranks of the truth (even: right, U: too sure)"
    return rrb.BarChartView(origin=f"/{RANKS}", name=name, plot_legend=rrb.PlotLegend(visible=False))


def _band_ends(values: FloatArray, weights: FloatArray) -> FloatArray:
    """The ends of the bands, (2, K); of many particles those of a thousand resampled ones, since sorting takes longest.

    The weight beyond an end is then 5 % with a standard error of at most 0.7 %, √(0.05 · 0.95 / 1000).
    """
    if len(values) <= _MOST_SORTED:
        return weighted_quantiles(values, weights, _BAND)
    drawn = np.take(values.T, systematic_indices(weights, 0.5, _MOST_SORTED), axis=1)
    ends = [round(level * _MOST_SORTED) - 1 for level in _BAND]
    drawn.partition(ends, axis=1)
    return drawn[:, ends].T


def _band(name: str, row: str, root: str = PARAMETERS) -> str:
    return f"{root}/{name}/{row}"


def _bars(edges: FloatArray, fill: float) -> dict[str, FloatArray]:
    """Bars in the middle of their bins, `fill` of a bin wide; the viewer's abscissa is a bar's left edge."""
    bin_width = edges[1] - edges[0]
    left = edges[:-1] + 0.5 * (1.0 - fill) * bin_width
    return {"abscissa": left, "widths": np.full(len(left), fill * bin_width)}
