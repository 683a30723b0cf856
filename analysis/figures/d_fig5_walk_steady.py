"""Paper D, fig. 5: a walk fitted in one style.

From points_walk_steady.
"""

from collections.abc import Mapping

from matplotlib.figure import Figure

from analysis.figures.sequences import fitted
from analysis.figures.told import accuracy, legs
from workbench.recording.read.reader import Run

EXPERIMENTS = ("points_walk_steady",)


def draw(runs: Mapping[str, Run]) -> Figure:
    """The fit in frames from the first to the last."""
    run = runs["points_walk_steady"]
    words = f"{accuracy(run)}; {legs(run)}. The paper: the legs are correctly positioned; no errors given."
    return fitted("Paper D, fig. 5: a walk in one style", run, words)
