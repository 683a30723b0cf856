"""The layout that papers A, B and C share: frames of one run in a row, with the expected pose over the images."""

from collections.abc import Mapping

from matplotlib.figure import Figure

from analysis.figures.panels import bodies, evenly, images, over_frames, skeletons
from analysis.figures.style import canvas, rows
from analysis.figures.told import accuracy, setup
from workbench.recording.read.reader import Run
from workbench.recording.study.drawing import ESTIMATE, SERIES

N_FRAMES = 6
"""As in the papers: frames 0, 10, …, 50 or 5, 10, …, 30."""
KEY = "Orange: expected pose; blue: truth; violet: particles."


def tracked(title: str, run: Run, paper: str) -> Figure:
    """Images with the posterior's skeletons above, the expected pose in space below, the error over frames."""
    frames = evenly(run, N_FRAMES)
    figure = canvas(title, 5.2, f"{KEY} Ours: {setup(run)}; {accuracy(run)}. {paper}")
    above, middle, below = rows(figure, (2.0, 1.9, 1.2), ("", "expected pose in space", ""))
    images(above.subplots(1, len(frames)), run, frames)
    skeletons(middle.subplots(1, len(frames)), run, frames)
    over_frames(below.subplots(), {"": run}, "error_px", "error (px)", {"": ESTIMATE})
    return figure


def compared(title: str, runs: Mapping[str, Run], paper: str) -> Figure:
    """A row of images for each run, named by its key, and their errors over frames."""
    sentences = " ".join(f"{label}: {accuracy(run)}." for label, run in runs.items())
    figure = canvas(title, 1.9 * len(runs) + 1.9, f"{KEY} {sentences} {paper}")
    parts = rows(figure, [1.9] * len(runs) + [1.3], [f"{label}: {setup(run)}" for label, run in runs.items()] + [""])
    for part, run in zip(parts, runs.values(), strict=False):
        frames = evenly(run, N_FRAMES)
        images(part.subplots(1, len(frames)), run, frames)
    colours = dict(zip(runs, SERIES[2:], strict=False))
    over_frames(parts[-1].subplots(), runs, "error_px", "error (px)", colours)
    return figure


def fitted(title: str, run: Run, words: str, n_frames: int = 7) -> Figure:
    """The surface fitted to points, in frames from the first to the last."""
    frames = evenly(run, n_frames)
    figure = canvas(title, 2.3, f"Black: observed points; blue: true skeleton; solid: fit. Ours: {setup(run)}; {words}")
    bodies(figure.subplots(1, len(frames)), run, frames)
    return figure
