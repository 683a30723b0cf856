"""Paper A, fig. 6: tracking a person on a circular walk.

From walk_circle: 15 000 particles under a walking prior that was learned from straight walks.
"""

from collections.abc import Mapping

from matplotlib.figure import Figure

from analysis.figures.readings import BOTH, Reading
from analysis.figures.sequences import tracked

EXPERIMENTS = ("walk_circle",)
READINGS = BOTH


def draw(readings: Mapping[str, Reading]) -> Figure:
    """Draw images above, the expected pose in space below."""
    paper = "The paper: 15 000 particles; in frame 50 the model starts to drift off, its rotation poorly estimated."
    return tracked("Paper A, fig. 6: a walk on a circle", readings["walk_circle"], paper)
