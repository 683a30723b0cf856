"""Paper B, fig. 2: tracking a walk with a prior that was learned from motion with gaps.

From walk_cyclic: 10 000 particles.
"""

from collections.abc import Mapping

from matplotlib.figure import Figure

from analysis.figures.sequences import tracked
from workbench.recording.read.reader import Run

EXPERIMENTS = ("walk_cyclic",)


def draw(runs: Mapping[str, Run]) -> Figure:
    """Images above, the expected pose in space below."""
    run = runs["walk_cyclic"]
    missing = 100 * run.settings["prior"]["missing"]
    paper = f"Learned with {missing:.0f} % of the samples missing. The paper: 10 000 particles, held; no errors given."
    return tracked("Paper B, fig. 2: a walk under the cyclic prior", run, paper)
