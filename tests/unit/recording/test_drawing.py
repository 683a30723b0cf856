"""A study's figures as drawings: where curves, bars and points lie, and what is drawn of little."""

import cv2
import numpy as np
import pytest
from matplotlib.figure import Figure

from workbench.core.study import Bars, Curves, Scatter
from workbench.recording.study.drawing import SERIES, draw, picture
from workbench.recording.study.figures import figure_of, numbers


def drawn(figure):
    axes = Figure().add_subplot()
    draw(axes, figure)
    return axes


def test_curves_lie_where_their_values_are_and_stop_at_gaps():
    x, y = np.linspace(2.0, 5.0, 31), np.sin(np.linspace(2.0, 5.0, 31))
    y[[10, 11, 13]] = np.nan  # 12 stands alone
    axes = drawn(Curves("f", x, {"a": y}, "x", "y", marks={"m": 3.0}, faint={"b": -y}))
    (curve,) = [line for line in axes.lines if line.get_color() == SERIES[0]]
    np.testing.assert_array_equal(curve.get_xydata(), np.column_stack([x, y]))
    assert curve.get_markevery().tolist() == [12]
    assert sorted(text.get_text() for text in axes.texts) == ["a", "m 3"]
    assert (axes.get_xlabel(), axes.get_ylabel(), axes.get_xlim()) == ("x", "y", (2.0, 5.0))


def test_bars_reach_from_zero_to_their_heights():
    heights = np.array([1.0, 4.0, 0.0, 2.0])
    axes = drawn(Bars("h", np.arange(4.0), heights, "x", heights + 1.0))
    values, edges, _ = axes.patches[0].get_data()
    assert (values.tolist(), edges.tolist()) == (heights.tolist(), [-0.5, 0.5, 1.5, 2.5, 3.5])
    assert axes.get_ylim()[0] == 0.0
    assert axes.lines[0].get_ydata().tolist() == (heights + 1.0).tolist()


def test_points_lie_where_their_values_are_and_are_named():
    points = {"walk": np.array([[0.0, 1.0], [np.nan, 2.0]]), "run": np.array([[3.0, 4.0]])}
    axes = drawn(Scatter("s", points, "x", "y"))
    np.testing.assert_array_equal(axes.collections[0].get_offsets().filled(np.nan)[0], [0.0, 1.0])
    np.testing.assert_array_equal(axes.collections[1].get_offsets(), [[3.0, 4.0]])
    assert [text.get_text() for text in axes.get_legend().texts] == ["walk", "run"]


@pytest.mark.parametrize(
    "figure",
    [
        *(Curves("f", np.arange(5.0), {"a": y}, "α₁", "σ") for y in (np.zeros(5), np.full(5, np.nan))),
        Curves("f", np.ones(1), {"a": np.ones(1)}, "x", "y"),
        Bars("f", np.zeros(1), np.ones(1), "x"),
        *(Scatter("f", {"a": xy}, "x", "y") for xy in (np.zeros((0, 2)), np.full((2, 2), np.nan))),
    ],
)
def test_a_picture_is_finer_than_the_view_and_always_the_same(figure):
    png = picture(figure, 300.0, 200.0)
    assert cv2.imdecode(np.frombuffer(png, np.uint8), cv2.IMREAD_COLOR).shape == (300, 450, 3)
    assert picture(figure, 300.0, 200.0) == png


def test_the_numbers_of_points_come_back_bit_for_bit():
    rng = np.random.default_rng(1)
    figure = Scatter("page/s", {"walk": rng.normal(size=(4, 2)), "run": rng.normal(size=(1, 2))}, "α₁", "α₂")
    again = figure_of(numbers(figure))
    assert isinstance(again, Scatter)
    assert (again.name, again.x_name, again.y_name) == (figure.name, "α₁", "α₂")
    assert list(again.points) == ["walk", "run"]
    for label, points in figure.points.items():
        assert again.points[label].tobytes() == points.tobytes()
