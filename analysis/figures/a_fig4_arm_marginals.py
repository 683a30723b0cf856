"""Paper A, fig. 4: tracking one arm; marginals of the shoulder's angles over frames.

From arm_twist: 2000 particles under the smooth prior, the twist of the upper arm unknown at first.
"""

from collections.abc import Mapping

import numpy as np
from matplotlib.figure import Figure

from analysis.figures.panels import evenly, images, marginal
from analysis.figures.readings import BOTH, DIFFERENCES, PaperFigure, Reading
from analysis.figures.sequences import KEY, N_FRAMES, words
from analysis.figures.style import canvas, rows
from workbench.recording.read.reader import Run
from workbench.utils.arrays import FloatArray

ANGLES = {
    "right_shoulder_flexion": "shoulder flexion",
    "right_shoulder_abduction": "shoulder abduction",
    "right_shoulder_twist": "upper arm's twist, θz",
    "right_elbow_flexion": "elbow flexion",
}


def draw(readings: Mapping[str, Reading]) -> Figure:
    """Draw for either reading images above, marginals below."""
    arm = readings["arm_twist"]
    bands = "; ".join(
        f"{reading}: {first:.0f}° wide in the first frame and {last:.0f}° in the last"
        for reading, run in arm.runs.items()
        for first, last in [band_deg(run, "right_shoulder_twist")[[0, -1]]]
    )
    figure = canvas(
        "Paper A, fig. 4: tracking one arm",
        3.7 * len(arm.runs) + 1.5,
        f"{KEY} Brightness: log posterior. {words({'': arm})} The twist's 5–95 % band, {bands}. Ours compares what no "
        "limb covers with a background that stands still, which A does not. The paper: 2000 particles; the twist "
        f"starts uniform and concentrates near the true value around frame 20, when the elbow bends. {DIFFERENCES}",
    )
    titles = [line for reading in arm.runs for line in (arm.row(reading), "")]
    parts = rows(figure, (1.7, 1.9) * len(arm.runs), titles)
    for above, below, run in zip(parts[0::2], parts[1::2], arm.runs.values(), strict=True):
        frames = evenly(run, N_FRAMES)
        images(above.subplots(1, len(frames)), run, frames)
        row = below.subplots(1, len(ANGLES))
        for axes, (name, title) in zip(row, ANGLES.items(), strict=True):
            marginal(axes, run, name, title)
        row[0].set_ylabel("degrees")
    return figure


def band_deg(run: Run, name: str) -> FloatArray:
    """Return the width of a parameter's 5–95 % band in every frame, degrees."""
    low, high = (run.scalars[f"posterior/parameters/{name}/{end}"].values[:, 0] for end in ("low", "high"))
    width: FloatArray = np.degrees(high - low)
    return width


FIGURES = {"a_fig4_arm_marginals": PaperFigure(("arm_twist",), BOTH, draw)}
