"""Paper D, fig. 5: a walk fitted in one style.

From points_walk_steady.
"""

from collections.abc import Mapping

from matplotlib.figure import Figure

from analysis.figures.readings import BOTH, Reading
from analysis.figures.sequences import fitted

EXPERIMENTS = ("points_walk_steady",)
READINGS = BOTH


def draw(readings: Mapping[str, Reading]) -> Figure:
    """Draw the fit in frames from the first to the last."""
    paper = "The paper: the legs are correctly positioned; no errors given."
    return fitted("Paper D, fig. 5: a walk in one style", readings["points_walk_steady"], paper)
