"""Paper D, fig. 1: a: the body, ellipsoids attached to a skeleton whose fields add up to a skin.

From points_walk_steady.
"""

from collections.abc import Mapping

from matplotlib.figure import Figure

from analysis.figures.panels import around, evenly
from analysis.figures.readings import OURS, Reading
from analysis.figures.style import canvas

EXPERIMENTS = ("points_walk_steady",)
READINGS = OURS
N_SIDES = 6


def draw(readings: Mapping[str, Reading]) -> Figure:
    """Draw the surface fitted in one frame and its skeleton, from several sides."""
    run = readings["points_walk_steady"].ours
    (frame,) = evenly(run, 1)
    figure = canvas(
        "Paper D, fig. 1: the body",
        2.3,
        f"Surface and skeleton fitted in frame {frame}, seen from around. The paper: 28 joints, about 80 degrees of "
        f"freedom; here {run.poses[1].shape[1]}.",
    )
    around(figure.subplots(1, N_SIDES), run, frame)
    return figure
