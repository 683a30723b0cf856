"""Paper C, fig. 6: tracking an arm with few particles.

From arm_smooth_300, and with a choice each, arm_implicit and arm_smooth_3000, which section 6 of the paper describes.
"""

from collections.abc import Mapping

from matplotlib.figure import Figure

from analysis.figures.readings import BOTH, Reading
from analysis.figures.sequences import compared

EXPERIMENTS = ("arm_implicit", "arm_smooth_300", "arm_smooth_3000")
READINGS = BOTH
NAMES = ("(a) implicit prior", "(b) constant velocity", "constant velocity, more particles")


def draw(readings: Mapping[str, Reading]) -> Figure:
    """Draw a row of images each, and all errors over frames."""
    paper = "The paper: 300 particles suffice with the implicit prior, constant velocity needs 3000."
    rows = {name: readings[experiment] for name, experiment in zip(NAMES, EXPERIMENTS, strict=True)}
    return compared("Paper C, fig. 6: an arm, 300 particles", rows, paper)
