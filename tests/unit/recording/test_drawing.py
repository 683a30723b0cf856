"""A study's figures as drawings: where curves, bars and points lie, and what is drawn of little."""

import cv2
import numpy as np
import pytest
from matplotlib.figure import Figure

from workbench.core.study import Bars, Curves, Scatter
from workbench.recording.study.drawing import draw, picture
from workbench.recording.study.figures import figure_of, numbers


def drawn(figure):
    axes = Figure().add_subplot()
    draw(axes, figure)
    return axes


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
