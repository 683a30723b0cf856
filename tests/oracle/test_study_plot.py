"""Where a plot puts its curves, bars and numbers."""

import numpy as np
import pytest

from workbench.recording.plot import drawing, plot, ticks
from workbench.studies.study import Bars, Curves

WIDTH, HEIGHT = 500.0, 300.0


def strips(shown, name):
    """The line strips drawn at an entity, as arrays (n, 2)."""
    entities = {path.rpartition("/")[2]: archetype for path, archetype in drawing("figure", shown)}
    return [np.array(strip) for strip in entities[name].strips.as_arrow_array().to_pylist()]


def values_at(shown, points):
    """The inverse of Plot.place, written by hand: x grows to the right, y upwards on the paper, downwards in pixels."""
    width, height = shown.size
    x = shown.low[0] + points[:, 0] / width * (shown.high[0] - shown.low[0])
    y = shown.high[1] - points[:, 1] / height * (shown.high[1] - shown.low[1])
    return x, y


def test_a_curve_lies_where_its_values_are_and_stops_at_gaps():
    x = np.linspace(2.0, 5.0, 31)
    y = np.sin(x)
    y[10:15] = np.nan
    shown = plot(Curves("f", x, {"a": y}, "x", "y"), WIDTH, HEIGHT)
    first, second = strips(shown, "curves")[::-1]  # later ones are drawn above: the first comes last
    for strip, known in ((first, slice(0, 10)), (second, slice(15, 31))):
        found = values_at(shown, strip)
        assert found[0] == pytest.approx(x[known], abs=1e-5)  # float32 pixels
        assert found[1] == pytest.approx(y[known], abs=1e-5)


def test_everything_lies_inside_the_axes_and_the_axes_inside_the_view():
    x = np.arange(30.0)
    figure = Curves("f", x, {"a": x**2 - 100.0}, "x", "y", marks={"m": 3.0}, faint={"b": -(x**2)})
    shown = plot(figure, WIDTH, HEIGHT)
    for name in ("curves", "faint", "marks"):
        for strip in strips(shown, name):
            assert (strip >= -1e-3).all()
            assert (strip <= shown.size + 1e-3).all()
    (left, right), (top, bottom) = shown.bounds
    assert (left, top) < (0.0, 0.0)
    assert (right, bottom) > tuple(shown.size)
    assert right - left == pytest.approx(WIDTH)
    assert all(left <= place[0] <= right and top <= place[1] <= 0.0 for _, _, place in shown.legend)


def test_bars_reach_from_zero_to_their_heights():
    heights = np.array([1.0, 4.0, 0.0, 2.0])
    shown = plot(Bars("h", np.arange(4.0), heights, "x"), WIDTH, HEIGHT)
    found = np.array([values_at(shown, strip) for strip in strips(shown, "bars")])  # (strokes, x or y, foot or top)
    assert found[:, 1, 0] == pytest.approx(0.0, abs=1e-5)
    for k, height in enumerate(heights):
        mine = np.abs(found[:, 0, 0] - k) < 0.5
        assert mine.any() == (height > 0.0)
        assert found[mine, 1, 1] == pytest.approx(height, abs=1e-5)


@pytest.mark.parametrize(("low", "high"), [(0.0, 1.0), (-0.03, 0.97), (72.0, 147.0), (-1e-6, 3e-6), (0.0, 12345.0)])
@pytest.mark.parametrize("most", [3, 5, 8])
def test_ticks_are_few_round_and_inside(low, high, most):
    found = ticks(low, high, most)
    step = found[1] - found[0] if len(found) > 1 else high - low
    assert 1 <= len(found) <= most
    assert found[0] >= low - 1e-9 * step
    assert found[-1] <= high + 1e-9 * step
    if len(found) > 1:
        mantissa = step / 10.0 ** np.floor(np.log10(step) + 1e-9)
        assert min(abs(mantissa - round_) for round_ in (1.0, 2.0, 5.0)) < 1e-6
        assert found / step == pytest.approx(np.rint(found / step), abs=1e-6)


@pytest.mark.parametrize("y", [np.zeros(5), np.full(5, -3.0), np.full(5, np.nan)])
def test_values_without_extent_still_make_a_plot(y):
    shown = plot(Curves("f", np.arange(5.0), {"a": y}, "x", "y"), WIDTH, HEIGHT)
    assert (shown.high > shown.low).all()
    assert len(list(drawing("f", shown))) >= 4
