"""Paper D, fig. 8: a run fitted in a style per frame.

From points_run_variable.
"""

from collections.abc import Mapping

from matplotlib.figure import Figure

from analysis.figures.readings import BOTH, Reading
from analysis.figures.sequences import fitted

EXPERIMENTS = ("points_run_variable",)
READINGS = BOTH


def draw(readings: Mapping[str, Reading]) -> Figure:
    """Draw the fit in frames from the first to the last."""
    paper = "The paper: the legs are right in the whole sequence."
    return fitted("Paper D, fig. 8: a run, style varying", readings["points_run_variable"], paper)
