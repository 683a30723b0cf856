"""Paper D, fig. 7: a run fitted in one style.

From points_run_steady.
"""

from collections.abc import Mapping

from matplotlib.figure import Figure

from analysis.figures.readings import BOTH, Reading
from analysis.figures.sequences import fitted

EXPERIMENTS = ("points_run_steady",)
READINGS = BOTH


def draw(readings: Mapping[str, Reading]) -> Figure:
    """Draw the fit in frames from the first to the last."""
    paper = "The paper: the legs are right but for the left one in the first frame."
    return fitted("Paper D, fig. 7: a run in one style", readings["points_run_steady"], paper)
