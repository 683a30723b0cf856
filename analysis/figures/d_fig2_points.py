"""Paper D, fig. 2: the points that are fitted, from where they were seen and from the side.

From points_run_steady.
"""

from collections.abc import Mapping

from matplotlib.figure import Figure

from analysis.figures.panels import evenly, points
from analysis.figures.readings import OURS, Reading
from analysis.figures.run_descriptions import setup
from analysis.figures.style import canvas, rows

EXPERIMENTS = ("points_run_steady",)
READINGS = OURS
VIEWS_DEG = {"from where they were seen": 0.0, "from the side": 90.0}


def draw(readings: Mapping[str, Reading]) -> Figure:
    """Draw a row from the front, where the points look dense, and one from the side, which shows how they err in
    depth."""
    run = readings["points_run_steady"].ours
    figure = canvas(
        "Paper D, fig. 2: noisy points of one side of the body",
        3.9,
        f"Black: points; blue: true skeleton. Ours: {setup(run)}; simulated. The paper: Digiclops, 640 × 480 at 14 Hz; "
        "very noisy and without depth; no number.",
    )
    frames = evenly(run, 7)
    parts = rows(figure, [1.0] * len(VIEWS_DEG), list(VIEWS_DEG))
    for part, turned in zip(parts, VIEWS_DEG.values(), strict=True):
        points(part.subplots(1, len(frames)), run, frames, turned)
    return figure
