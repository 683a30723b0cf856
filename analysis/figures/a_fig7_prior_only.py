"""Paper A, fig. 7: strength of the walking prior; the same walk with and without images.

From walk_straight and walk_prior_only, which has a uniform likelihood.
"""

from collections.abc import Mapping

from matplotlib.figure import Figure

from analysis.figures.readings import BOTH, Reading
from analysis.figures.sequences import compared

EXPERIMENTS = ("walk_straight", "walk_prior_only")
READINGS = BOTH


def draw(readings: Mapping[str, Reading]) -> Figure:
    """Draw a row of images each, and both errors over frames."""
    paper = (
        "The paper repeats the walk on a circle so, as does the literal row, ours the straight one: the prior keeps "
        "the pose that of a walk, but without images the figure walks its own way."
    )
    rows = {"Image motion": readings["walk_straight"], "Prior only": readings["walk_prior_only"]}
    return compared("Paper A, fig. 7: how strong is the walking prior?", rows, paper)
