"""Paper B, fig. 2: tracking a walk with a prior that was learned from motion with gaps.

From walk_cyclic: 10 000 particles.
"""

from collections.abc import Mapping

from matplotlib.figure import Figure

from analysis.figures.readings import BOTH, Reading
from analysis.figures.sequences import tracked

EXPERIMENTS = ("walk_cyclic",)
READINGS = BOTH


def draw(readings: Mapping[str, Reading]) -> Figure:
    """Draw images above, the expected pose in space below."""
    missing = 100 * readings["walk_cyclic"].ours.settings["prior"]["missing_fraction"]
    paper = (
        f"Learned with {missing:.0f} % of the samples missing. The paper: 10 000 particles, tracked; no errors given."
    )
    return tracked("Paper B, fig. 2: a walk under the cyclic prior", readings["walk_cyclic"], paper)
