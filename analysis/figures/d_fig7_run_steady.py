"""Paper D, fig. 7: a run fitted in one style.

From points_run_steady.
"""

from collections.abc import Mapping

from matplotlib.figure import Figure

from analysis.figures.sequences import fitted
from analysis.figures.told import accuracy, legs
from workbench.recording.read.reader import Run

EXPERIMENTS = ("points_run_steady",)


def draw(runs: Mapping[str, Run]) -> Figure:
    """The fit in frames from the first to the last."""
    run = runs["points_run_steady"]
    words = f"{accuracy(run)}; {legs(run)}. The paper: the legs are right but for the left one in the first frame."
    return fitted("Paper D, fig. 7: a run in one style", run, words)
