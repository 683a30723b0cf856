"""Paper D, fig. 4: the first eigenvectors for the left knee's flexion, and their derivatives.

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
ANGLE = "eigenvectors/left knee flexion"


def draw(readings: Mapping[str, Reading]) -> Figure:
    """Draw eigenvectors on the left, derivatives on the right."""
    run = readings["learn_walk_run"].ours
    caption = (
        f"Each scaled by its standard deviation over {run.result['n_examples']:.0f} cycles. The paper draws five, in "
        "no stated unit."
    )
    figure = canvas("Paper D, fig. 4: eigenvectors of the left knee's flexion", 3.0, caption)
    for axes, name, title in zip(figure.subplots(1, 2), (ANGLE, f"{ANGLE}, derivative"), ("Θ", "∂Θ/∂μ"), strict=True):
        draw_figure(axes, figure_named(run, name))
        axes.set_title(title)
    return figure
