"""Paper D, fig. 1b and 1c: one motion model of walking and running.

From learn_walk_run.
"""

from collections.abc import Mapping

from matplotlib.figure import Figure

from analysis.figures.readings import OURS, Reading
from analysis.figures.studies import figure_named
from analysis.figures.style import canvas
from workbench.recording.study.drawing import draw as draw_figure

EXPERIMENTS = ("learn_walk_run",)
READINGS = OURS


def draw(readings: Mapping[str, Reading]) -> Figure:
    """Draw the examples' first two coefficients, of the whole body and of the legs; the variance explained."""
    run = readings["learn_walk_run"].ours
    result = run.result
    figure = canvas(
        "Paper D, fig. 1: a motion model of walking and running",
        3.1,
        f"Ours: {result['n_examples']:.0f} cycles of {result['n_clips']:.0f} clips; 0.9 of the variance takes "
        f"{result['n_components_90']:.0f} components (legs: {result['n_components_90_legs']:.0f}); two components tell "
        f"the activity of {100 * result['activity_accuracy_2']:.1f} % of the examples (legs: "
        f"{100 * result['activity_accuracy_2_legs']:.1f} %) without their clip. The paper: 256 examples of 4 people "
        "on a treadmill; 5 components for 0.9; two separate clusters.",
    )
    body, legs, shares = figure.subplots(1, 3)
    for axes, part in ((body, "whole body"), (legs, "legs")):
        draw_figure(axes, figure_named(run, f"model/first two components, {part}"))
        axes.set_title(f"(b) {part.removeprefix('whole ')}")
    explained = figure_named(run, "model/explained variance")
    draw_figure(shares, explained)
    shares.set_title("(c) variance explained")
    return figure
