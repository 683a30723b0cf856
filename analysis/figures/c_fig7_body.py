"""Paper C, fig. 7: tracking a walker with few particles.

From body_implicit, whose database does not hold the walker, and body_smooth.
"""

from collections.abc import Mapping

from matplotlib.figure import Figure

from analysis.figures.readings import BOTH, Reading
from analysis.figures.sequences import compared

EXPERIMENTS = ("body_implicit", "body_smooth")
READINGS = BOTH


def draw(readings: Mapping[str, Reading]) -> Figure:
    """Draw a row of images each, and both errors over frames."""
    paper = "The paper: 300 particles track 30 frames with the implicit prior and do not with constant velocity."
    rows = {"(a) implicit prior": readings["body_implicit"], "(b) constant velocity": readings["body_smooth"]}
    return compared("Paper C, fig. 7: a walker, 300 particles", rows, paper)
