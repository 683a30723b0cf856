"""Paper D, fig. 9: a walk fitted in a style per frame.

From points_walk_variable.
"""

from collections.abc import Mapping

from matplotlib.figure import Figure

from analysis.figures.readings import BOTH, Reading
from analysis.figures.sequences import fitted

EXPERIMENTS = ("points_walk_variable",)
READINGS = BOTH


def draw(readings: Mapping[str, Reading]) -> Figure:
    """Draw the fit in frames from the first to the last."""
    paper = "The paper: 18 frames, the legs are right; no errors given."
    return fitted("Paper D, fig. 9: a walk, style varying", readings["points_walk_variable"], paper)
