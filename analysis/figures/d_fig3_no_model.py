"""Paper D, fig. 3: fitting points frame by frame without a motion model.

From points_no_model, from a rough first pose.
"""

from collections.abc import Mapping

from matplotlib.figure import Figure

from analysis.figures.readings import BOTH, Reading
from analysis.figures.sequences import fitted

EXPERIMENTS = ("points_no_model",)
READINGS = BOTH


def draw(readings: Mapping[str, Reading]) -> Figure:
    """Draw the fit in frames from the first to the last."""
    paper = "The paper: both legs are attracted to the same points; no errors given."
    return fitted("Paper D, fig. 3: no motion model", readings["points_no_model"], paper)
