"""Paper A, fig. 5: tracking a person on a straight walk.

From walk_straight: 5000 particles under the walking prior.
"""

from collections.abc import Mapping

from matplotlib.figure import Figure

from analysis.figures.readings import BOTH, Reading
from analysis.figures.sequences import tracked

EXPERIMENTS = ("walk_straight",)
READINGS = BOTH


def draw(readings: Mapping[str, Reading]) -> Figure:
    """Draw images above, the expected pose in space below."""
    paper = "The paper: 5000 particles, 50 frames, tracked; arms often poorly estimated; no errors given."
    return tracked("Paper A, fig. 5: a walk in a straight line", readings["walk_straight"], paper)
