"""Paper D, fig. 10: a walk that becomes a run.

From points_transition: two clips spliced, neither learned from; the activity is told frame by frame.
"""

from collections.abc import Mapping

from matplotlib.figure import Figure

from analysis.figures.frames import activities
from analysis.figures.panels import activity_lanes, bodies, evenly
from analysis.figures.style import canvas, rows
from analysis.figures.told import accuracy, setup
from workbench.recording.read.reader import Run

EXPERIMENTS = ("points_transition",)


def draw(runs: Mapping[str, Run]) -> Figure:
    """The fit in frames from the first to the last; the activity told and the true one over all frames."""
    run = runs["points_transition"]
    figure = canvas(
        "Paper D, fig. 10: from walking to running",
        3.4,
        f"Black: observed points; blue: true skeleton; solid: fit. Ours: {setup(run)}; {accuracy(run)}; the activity "
        f"is told right in {100 * run.result['activity_accuracy']:.0f} % of the frames. The paper: four frames of "
        "walking, three of transition, then running; it tells no activities.",
    )
    above, below = rows(figure, (1.9, 0.75), ("", ""))
    frames = evenly(run, 8)
    bodies(above.subplots(1, len(frames)), run, frames)
    activity_lanes(below.subplots(), run, activities(run))
    return figure
