"""Charts of joint angles as the coordinates of an SVG: curves of left and right, their bands, axes."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from workbench.evaluation.gait.joint_angles import CONVENTIONS
from workbench.results.measure.measures import Curve, Measures
from workbench.utils.arrays import FloatArray

WIDTH, HEIGHT = 400, 240
LEFT, RIGHT, TOP, BOTTOM = 44, 392, 26, 204
"""Edges of the axes in the chart, in its units."""
_MAX_POINTS = 600
"""Most points of a curve, more than the chart has pixels."""
_MAX_STRIDES = 12
"""Most strides drawn of each side, evenly chosen."""
_STEPS = (1, 2, 5, 10, 20, 30, 50, 100, 200, 500)
_MAX_TICKS = 6


@dataclass(frozen=True)
class Line:
    """A curve. side: left, right or both, its style. points: of the mean. band: outline of the interval, "" without
    one. strides: points of single strides. toe_off: x of the mean toe-off, None without one."""

    side: str
    points: str
    band: str
    strides: tuple[str, ...]
    toe_off: float | None


@dataclass(frozen=True)
class Chart:
    """A chart. ticks: (place, label) of each tick of an axis."""

    title: str
    positive: str
    lines: tuple[Line, ...]
    x_ticks: tuple[tuple[float, str], ...]
    y_ticks: tuple[tuple[float, str], ...]


def charts_of(measures: Measures) -> list[Chart]:
    """Return a chart for each angle, with the curves of both sides."""
    names = dict.fromkeys(curve.name for curve in measures.curves)
    stance = measures.table[measures.table["measure"] == "stance"].set_index("side")["estimate"].to_dict()
    grouped = [[curve for curve in measures.curves if curve.name == name and len(curve.x) > 1] for name in names]
    return [_chart(curves, stance) for curves in grouped if curves]


def _chart(curves: Sequence[Curve], stance: dict[str, float]) -> Chart:
    drawn = [values for curve in curves for values in (curve.mean, curve.low, curve.high, _chosen(curve.strides))]
    every = np.concatenate([values[np.isfinite(values)] for values in drawn])
    y_ticks = _ticks(float(every.min()), float(every.max()), widen=True)
    x_ticks = _ticks(float(curves[0].x[0]), float(curves[0].x[-1]), widen=False)
    x_range, y_range = (float(curves[0].x[0]), float(curves[0].x[-1])), (y_ticks[0], y_ticks[-1])

    def across(x: float | FloatArray) -> float | FloatArray:
        return LEFT + (x - x_range[0]) / (x_range[1] - x_range[0]) * (RIGHT - LEFT)

    def down(y: float | FloatArray) -> float | FloatArray:
        return BOTTOM - (y - y_range[0]) / (y_range[1] - y_range[0]) * (BOTTOM - TOP)

    def points(x: FloatArray, y: FloatArray) -> str:
        return " ".join(f"{a:.1f},{b:.1f}" for a, b in zip(across(x), down(y), strict=True))  # type: ignore[arg-type]

    lines = []
    for curve in curves:
        rows = np.arange(0, len(curve.x), -(-len(curve.x) // _MAX_POINTS))
        x, low, high = curve.x[rows], curve.low[rows], curve.high[rows]
        band = points(np.append(x, x[::-1]), np.append(high, low[::-1])) if np.isfinite(low).all() else ""
        strides = tuple(points(x, stride[rows]) for stride in _chosen(curve.strides))
        toe_off = stance.get(curve.side)
        mark = float(across(toe_off)) if toe_off is not None and np.isfinite(toe_off) else None
        lines.append(Line(curve.side, points(x, curve.mean[rows]), band, strides, mark))
    convention = CONVENTIONS[curves[0].name]
    return Chart(
        convention.title, convention.positive, tuple(lines),
        tuple((float(across(x)), f"{x:g}") for x in x_ticks), tuple((float(down(y)), f"{y:g}") for y in y_ticks),
    )  # fmt: skip


def _chosen(strides: FloatArray) -> FloatArray:
    """Return up to _MAX_STRIDES of strides (k, n)."""
    rows = np.unique(np.linspace(0, len(strides) - 1, min(len(strides), _MAX_STRIDES)).round().astype(np.int64))
    return strides[rows]


def _ticks(low: float, high: float, widen: bool) -> list[float]:
    """Return up to about _MAX_TICKS round numbers within low and high, or around them."""
    step = next((each for each in _STEPS if (high - low) / each <= _MAX_TICKS), _STEPS[-1])
    if high - low < _MAX_TICKS * 0.2:  # less than a second
        step = max((high - low) / 2.0, 1e-3)  # type: ignore[assignment]
    first, last = (
        (np.floor(low / step), np.ceil(high / step)) if widen else (np.ceil(low / step), np.floor(high / step))
    )
    return [round(float(k * step), 6) for k in np.arange(first, max(last, first + 1) + 0.5)]
