"""Paper A, fig. 4: tracking one arm; marginals of the shoulder's angles over frames.

From arm_twist: 2000 particles under the smooth prior, the twist of the upper arm unknown at first.
"""

from collections.abc import Mapping

import numpy as np
from matplotlib.figure import Figure

from analysis.figures.panels import evenly, images, marginal
from analysis.figures.sequences import KEY, N_FRAMES
from analysis.figures.style import canvas, rows
from analysis.figures.told import accuracy, setup
from workbench.arrays import FloatArray
from workbench.recording.read.reader import Run

EXPERIMENTS = ("arm_twist",)
ANGLES = {
    "right_shoulder_flexion": "shoulder flexion",
    "right_shoulder_abduction": "shoulder abduction",
    "right_shoulder_twist": "upper arm's twist, θz",
    "right_elbow_flexion": "elbow flexion",
}


def draw(runs: Mapping[str, Run]) -> Figure:
    """Images above, marginals below."""
    run = runs["arm_twist"]
    first, last = band_deg(run, "right_shoulder_twist")[[0, -1]]
    figure = canvas(
        "Paper A, fig. 4: tracking one arm",
        4.3,
        f"{KEY} Brightness: log posterior. Ours: {setup(run)}; {accuracy(run)}. The twist's 5–95 % band is "
        f"{first:.0f}° wide in the first frame and {last:.0f}° in the last. The paper: 2000 particles; the twist "
        "starts uniform and concentrates near the true value around frame 20, when the elbow bends.",
    )
    above, below = rows(figure, (1.7, 1.9), ("", ""))
    frames = evenly(run, N_FRAMES)
    images(above.subplots(1, len(frames)), run, frames)
    row = below.subplots(1, len(ANGLES))
    for axes, (name, title) in zip(row, ANGLES.items(), strict=True):
        marginal(axes, run, name, title)
    row[0].set_ylabel("degrees")
    return figure


def band_deg(run: Run, name: str) -> FloatArray:
    """The width of a parameter's 5–95 % band in every frame, degrees."""
    low, high = (run.scalars[f"posterior/parameters/{name}/{end}"].values[:, 0] for end in ("low", "high"))
    width: FloatArray = np.degrees(high - low)
    return width
