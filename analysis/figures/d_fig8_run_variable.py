"""Paper D, fig. 8: a run fitted in a style per frame.

From points_run_variable.
"""

from collections.abc import Mapping

from matplotlib.figure import Figure

from analysis.figures.sequences import fitted
from analysis.figures.told import accuracy, legs
from workbench.recording.read.reader import Run

EXPERIMENTS = ("points_run_variable",)


def draw(runs: Mapping[str, Run]) -> Figure:
    """The fit in frames from the first to the last."""
    run = runs["points_run_variable"]
    words = f"{accuracy(run)}; {legs(run)}. The paper: the legs are right in the whole sequence."
    return fitted("Paper D, fig. 8: a run, style varying", run, words)
