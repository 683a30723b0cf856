"""Paper D, fig. 9: a walk fitted in a style per frame.

From points_walk_variable.
"""

from collections.abc import Mapping

from matplotlib.figure import Figure

from analysis.figures.sequences import fitted
from analysis.figures.told import accuracy, legs
from workbench.recording.read.reader import Run

EXPERIMENTS = ("points_walk_variable",)


def draw(runs: Mapping[str, Run]) -> Figure:
    """The fit in frames from the first to the last."""
    run = runs["points_walk_variable"]
    words = f"{accuracy(run)}; {legs(run)}. The paper: 18 frames, the legs are right; no errors given."
    return fitted("Paper D, fig. 9: a walk, style varying", run, words)
