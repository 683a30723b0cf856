"""Paper D, fig. 3: fitting points frame by frame without a motion model.

From points_no_model, from the true pose.
"""

from collections.abc import Mapping

from matplotlib.figure import Figure

from analysis.figures.sequences import fitted
from analysis.figures.told import accuracy, legs
from workbench.recording.read.reader import Run

EXPERIMENTS = ("points_no_model",)


def draw(runs: Mapping[str, Run]) -> Figure:
    """The fit in frames from the first to the last."""
    run = runs["points_no_model"]
    words = f"{accuracy(run)}; {legs(run)}. The paper: both legs are attracted to the same points; no errors given."
    return fitted("Paper D, fig. 3: no motion model", run, words)
