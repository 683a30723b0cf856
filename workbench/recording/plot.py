"""Curves, bars and scattered points as drawings with axes, ticks and a legend of our own.

Rerun's views of time series share one time line, which cannot be a period, a phase and a count at once, and name no
axes. So a figure is drawn in a 2-D view, one unit a point of the screen in a window of the usual size, with y down.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import TypeAlias

import numpy as np
import rerun as rr

from workbench.arrays import BoolArray, FloatArray
from workbench.recording import colours
from workbench.studies.study import Bars, Curves, Scatter

Entities: TypeAlias = Iterator[tuple[str, rr.AsComponents]]
Rgb: TypeAlias = tuple[int, int, int]
Drawn: TypeAlias = Curves | Bars | Scatter

BACKGROUND = (13, 14, 16)
_GRID, _FRAME, _TEXT, _FAINT = (38, 40, 44), (90, 92, 96), (190, 190, 190), (78, 84, 94)
_COLOURS: tuple[Rgb, ...] = (
    colours.ESTIMATE, colours.TRUTH, (120, 220, 130), (255, 110, 160), (190, 150, 255), colours.MODEL,
    (240, 228, 66), (150, 170, 190),
)  # fmt: skip
_MARK_COLOURS: tuple[Rgb, ...] = ((240, 228, 66), (225, 225, 225), (150, 170, 190))
_LEFT, _RIGHT, _BELOW, _ROW = 52.0, 14.0, 46.0, 22.0
_LETTER, _GAP = 6.4, 18.0  # a letter's mean width, and what lies between two entries of the legend
_FEW = 20  # curves of so few points show them


@dataclass(frozen=True, eq=False)
class Plot:
    """A figure laid out. low, high: (2,), the ends of the x and y axes. size: (2,), width and height of the area
    they span, whose upper left corner is the origin. legend: (text, colour, place (2,)).
    """

    figure: Drawn
    low: FloatArray
    high: FloatArray
    size: FloatArray
    legend: tuple[tuple[str, Rgb, tuple[float, float]], ...]

    @property
    def bounds(self) -> tuple[tuple[float, float], tuple[float, float]]:
        """What a view of the plot has to show: from left to right, from top to bottom."""
        top = self.legend[0][2][1] - _ROW  # the first row of the legend lies highest
        width, height = self.size
        return (-_LEFT, float(width) + _RIGHT), (top, float(height) + _BELOW)

    def place(self, x: FloatArray, y: FloatArray) -> FloatArray:
        """Points (n, 2) of the drawing for values x, y (n,)."""
        part = (np.stack([x, y], axis=-1) - self.low) / (self.high - self.low)
        placed: FloatArray = np.stack([part[..., 0], 1.0 - part[..., 1]], axis=-1) * self.size
        return placed


def plot(figure: Drawn, width: float, height: float) -> Plot:
    """Lay the figure out for a view of that size, in points of the screen."""
    inner = width - _LEFT - _RIGHT
    entries, n_rows = _legend(figure, inner)
    low, high = _ranges(figure)
    return Plot(figure, low, high, np.array([inner, max(height - _BELOW - n_rows * _ROW, 60.0)]), entries)


def drawing(path: str, shown: Plot) -> Entities:
    """All entities of the plot, below the entity `path`."""
    yield from _axes(path, shown)
    if isinstance(shown.figure, Bars):
        yield from _bars(path, shown, shown.figure)
    elif isinstance(shown.figure, Scatter):
        yield from _scatter(path, shown, shown.figure)
    else:
        yield from _curves(path, shown, shown.figure)
    texts, shades, places = zip(*shown.legend, strict=True)
    yield f"{path}/legend", _texts(texts, np.array(places), shades)


def ticks(low: float, high: float, most: int) -> FloatArray:
    """At most `most` round numbers, equally spaced by 1, 2 or 5 times a power of ten, between low and high."""
    least = (high - low) / max(most - 1, 1)
    power = 10.0 ** np.floor(np.log10(least))
    step = next(factor * power for factor in (1.0, 2.0, 5.0, 10.0) if factor * power >= least * (1.0 - 1e-9))
    first, last = np.ceil(low / step - 1e-9), np.floor(high / step + 1e-9)
    found: FloatArray = np.arange(first, last + 1.0) * step
    return found


def _ranges(figure: Drawn) -> tuple[FloatArray, FloatArray]:
    """Ends (2,) of the axes: x as it is, y with a margin, from zero where the values come near it."""
    if isinstance(figure, Scatter):
        return _scatter_ranges(figure)
    if isinstance(figure, Bars):
        half = 0.5 * _bar_width(figure)
        ends = (figure.x[0] - half, figure.x[-1] + half)
        values = [figure.heights, [0.0], [] if figure.model is None else figure.model]
    else:
        ends = (figure.x[0], figure.x[-1])
        values = [*figure.curves.values(), *figure.faint.values()]
    known = np.concatenate([np.asarray(value, dtype=np.float64) for value in values])
    known = known[np.isfinite(known)] if np.isfinite(known).any() else np.zeros(1)
    low, high = float(known.min()), float(known.max())
    low = 0.0 if 0.0 <= low < 0.4 * high else low
    margin = 0.06 * (high - low) or 0.5 * abs(high) or 0.5
    x_margin = 0.0 if ends[1] > ends[0] else 0.5
    bottom = low if low == 0.0 else low - margin
    return np.array([ends[0] - x_margin, bottom]), np.array([ends[1] + x_margin, high + margin])


def _scatter_ranges(figure: Scatter) -> tuple[FloatArray, FloatArray]:
    """Ends (2,) of both axes, with a margin beyond the points."""
    places = np.concatenate([np.zeros((0, 2)), *figure.points.values()])
    places = places[np.isfinite(places).all(axis=1)]
    low, high = (places.min(axis=0), places.max(axis=0)) if len(places) else (np.zeros(2), np.zeros(2))
    margin = np.where(high > low, 0.06 * (high - low), 0.5)
    return low - margin, high + margin


def _legend(figure: Drawn, width: float) -> tuple[tuple[tuple[str, Rgb, tuple[float, float]], ...], int]:
    """The y axis' name, then labels in their curves' colours, in rows above the plot; and how many rows."""
    if isinstance(figure, Bars):
        entries = [("data", _COLOURS[0])] + ([] if figure.model is None else [("model", colours.MODEL)])
    else:
        entries = [(figure.y_name, _TEXT)]
        labels = figure.points if isinstance(figure, Scatter) else figure.curves
        entries += [(label, _colour(k)) for k, label in enumerate(labels)]
    if isinstance(figure, Curves):
        entries += [(f"{label} {x:.4g}", _mark_colour(k)) for k, (label, x) in enumerate(figure.marks.items())]
    placed: list[tuple[str, Rgb, tuple[float, float]]] = []
    left, row = -_LEFT + 10.0, 0
    for text, colour in entries:
        wide = _LETTER * len(text)
        if placed and left + wide > width + _RIGHT:
            left, row = -_LEFT + 10.0, row + 1
        placed.append((text, colour, (left + 0.5 * wide, row * _ROW)))
        left += wide + _GAP
    return tuple((text, colour, (x, y - (row + 0.7) * _ROW)) for text, colour, (x, y) in placed), row + 1


def _axes(path: str, shown: Plot) -> Entities:
    """Grid, frame, numbers along the axes, the x axis' name."""
    (width, height), (x_low, y_low), (x_high, y_high) = shown.size, shown.low, shown.high
    xs, ys = ticks(x_low, x_high, max(3, int(width / 55.0))), ticks(y_low, y_high, max(3, int(height / 36.0)))
    columns = shown.place(xs, np.full(len(xs), y_low))
    rows = shown.place(np.full(len(ys), x_low), ys)
    grid = [np.array([[x, 0.0], [x, height]]) for x, _ in columns] + [np.array([[0.0, y], [width, y]]) for _, y in rows]
    frame = np.array([[0, 0], [0, height], [width, height], [width, 0], [0, 0]], dtype=np.float64)
    yield f"{path}/grid", _lines([*grid, frame], [*[_GRID] * len(grid), _FRAME], 0.5, -10.0)
    numbers = [_number(value) for value in (*xs, *ys)]
    left = [-6.0 - 0.5 * _LETTER * len(number) for number in numbers[len(xs) :]]
    places = np.vstack([columns + np.array([0.0, 12.0]), np.column_stack([left, rows[:, 1]])])
    yield f"{path}/numbers", _texts(numbers, places, [_TEXT] * len(numbers))
    yield f"{path}/x_name", _texts([shown.figure.x_name], np.array([[0.5 * width, height + 33.0]]), [_TEXT])


def _curves(path: str, shown: Plot, figure: Curves) -> Entities:
    strips, dots = _pieces(shown, figure.x, list(figure.faint.values()))
    if strips:
        yield f"{path}/faint", _lines([strip for _, strip in strips], [_FAINT] * len(strips), 0.5, 0.0)
    marks = [(x, _mark_colour(k)) for k, x in enumerate(figure.marks.values()) if np.isfinite(x)]
    if marks:
        ends = np.array([shown.low[1], shown.high[1]])
        strips_of_marks = [shown.place(np.full(2, x), ends) for x, _ in marks]
        yield f"{path}/marks", _lines(strips_of_marks, [colour for _, colour in marks], 0.7, 5.0)
    strips, dots = _pieces(shown, figure.x, list(figure.curves.values()))
    if strips:
        strips = strips[::-1]  # the first curve above the others
        shades = [_colour(k) for k, _ in strips]
        yield f"{path}/curves", _lines([strip for _, strip in strips], shades, 1.1, 10.0)
    if dots:
        places, shades = np.array([place for _, place in dots]), [_colour(k) for k, _ in dots]
        radii = rr.Radius.ui_points(2.5)
        yield f"{path}/points", rr.Points2D(places, colors=shades, radii=radii, draw_order=11.0)


def _bars(path: str, shown: Plot, figure: Bars) -> Entities:
    """Every bar as upright strokes side by side, since the viewer fills no boxes; the model as a curve."""
    step = 0.8 * _bar_width(figure)
    n = max(2, int(np.ceil(shown.size[0] * step / (shown.high[0] - shown.low[0]) / 2.0)))
    offsets = np.linspace(-0.5, 0.5, n) * step * (1.0 - 1.0 / n)
    x = (figure.x[:, None] + offsets).ravel()
    tops, feet = shown.place(x, np.repeat(figure.heights, n)), shown.place(x, np.zeros(len(x)))
    strokes = [np.array(ends) for ends in zip(feet, tops, strict=True) if ends[0][1] > ends[1][1]]
    if strokes:
        yield f"{path}/bars", _lines(strokes, [_COLOURS[0]] * len(strokes), 1.1, 0.0, in_ui_points=False)
    if figure.model is not None:
        yield f"{path}/model", _lines([shown.place(figure.x, figure.model)], [colours.MODEL], 1.2, 10.0)


def _scatter(path: str, shown: Plot, figure: Scatter) -> Entities:
    for k, points in enumerate(figure.points.values()):
        known = points[np.isfinite(points).all(axis=1)]
        if len(known):
            places, radii = shown.place(known[:, 0], known[:, 1]), rr.Radius.ui_points(1.8)
            yield f"{path}/points/{k}", rr.Points2D(places, colors=_colour(k), radii=radii, draw_order=10.0 + k)


def _bar_width(figure: Bars) -> float:
    return float(np.diff(figure.x).min()) if len(figure.x) > 1 else 1.0


def _pieces(
    shown: Plot, x: FloatArray, curves: Sequence[FloatArray]
) -> tuple[list[tuple[int, FloatArray]], list[tuple[int, FloatArray]]]:
    """(curve, strip (n, 2)) for every stretch without NaN, and (curve, place (2,)) where single points are shown."""
    strips, dots = [], []
    for k, curve in enumerate(curves):
        known: BoolArray = np.isfinite(curve)
        points = shown.place(x, curve)
        for stretch in np.split(np.arange(len(x)), np.flatnonzero(np.diff(known.astype(np.int8))) + 1):
            if known[stretch[0]] and len(stretch) > 1:
                strips.append((k, points[stretch]))
            if known[stretch[0]] and (len(stretch) == 1 or known.sum() <= _FEW):
                dots += [(k, point) for point in points[stretch]]
    return strips, dots


def _lines(
    strips: Sequence[FloatArray], shades: Sequence[Rgb], half_width: float, order: float, in_ui_points: bool = True
) -> rr.LineStrips2D:
    radii = rr.Radius.ui_points(half_width) if in_ui_points else half_width
    return rr.LineStrips2D(strips, colors=shades, radii=radii, draw_order=order)


def _texts(texts: Sequence[str], places: FloatArray, shades: Sequence[Rgb]) -> rr.Points2D:
    """Texts with their middles at places (n, 2): labels of points too small to see, which hang 11 units below."""
    lifted = places - np.array([0.0, 11.0])
    return rr.Points2D(lifted, labels=list(texts), colors=list(shades), radii=0.0, show_labels=True)


def _number(value: float) -> str:
    return f"{value:.6g}" if value else "0"  # never -0


def _colour(k: int) -> Rgb:
    return _COLOURS[k % len(_COLOURS)]


def _mark_colour(k: int) -> Rgb:
    return _MARK_COLOURS[k % len(_MARK_COLOURS)]
