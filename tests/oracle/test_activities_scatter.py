"""Scattered points: where they are drawn, and that their numbers come back."""

import numpy as np
import pytest

from workbench.recording.figures import figure_of, numbers
from workbench.recording.plot import drawing, plot
from workbench.studies.study import Scatter

WIDTH, HEIGHT = 500.0, 300.0


def drawn(shown):
    """The places (n, 2) drawn for every label, in order."""
    entities = dict(drawing("figure", shown))
    points = [entities[f"figure/points/{k}"] for k in range(len(shown.figure.points))]
    return [np.array(one.positions.as_arrow_array().to_pylist()) for one in points]


def test_points_lie_where_their_values_are_inside_the_axes():
    rng = np.random.default_rng(0)
    figure = Scatter("s", {"walk": rng.normal(size=(20, 2)), "run": 3.0 + rng.normal(size=(5, 2))}, "x", "y")
    shown = plot(figure, WIDTH, HEIGHT)
    width, height = shown.size
    for found, points in zip(drawn(shown), figure.points.values(), strict=True):
        x = shown.low[0] + found[:, 0] / width * (shown.high[0] - shown.low[0])
        y = shown.high[1] - found[:, 1] / height * (shown.high[1] - shown.low[1])
        assert np.column_stack([x, y]) == pytest.approx(points, abs=1e-5)  # float32 pixels
        assert (found > 0.0).all()
        assert (found < shown.size).all()
    assert [text for text, _, _ in shown.legend] == ["y", "walk", "run"]
    assert len({shade for _, shade, _ in shown.legend}) == 3


def test_points_that_are_not_numbers_are_left_out():
    figure = Scatter("s", {"a": np.array([[0.0, 1.0], [np.nan, 2.0], [3.0, 4.0]])}, "x", "y")
    assert len(drawn(plot(figure, WIDTH, HEIGHT))[0]) == 2


@pytest.mark.parametrize("points", [np.zeros((0, 2)), np.ones((1, 2)), np.full((2, 2), np.nan)])
def test_few_points_still_make_a_plot(points):
    shown = plot(Scatter("s", {"a": points}, "x", "y"), WIDTH, HEIGHT)
    assert (shown.high > shown.low).all()
    assert len(list(drawing("f", shown))) >= 3


def test_the_numbers_come_back_bit_for_bit():
    rng = np.random.default_rng(1)
    figure = Scatter("page/s", {"walk": rng.normal(size=(4, 2)), "run": rng.normal(size=(1, 2))}, "α₁", "α₂")
    again = figure_of(numbers(figure))
    assert isinstance(again, Scatter)
    assert (again.name, again.x_name, again.y_name) == (figure.name, "α₁", "α₂")
    assert list(again.points) == ["walk", "run"]
    for label, points in figure.points.items():
        assert again.points[label].shape == points.shape
        assert again.points[label].tobytes() == points.tobytes()
