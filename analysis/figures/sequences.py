"""Layouts shared by the papers: frames in a row, as the paper writes the experiment and as ours."""

from collections.abc import Mapping

from matplotlib.figure import Figure, SubFigure

from analysis.figures.panels import bodies, evenly, images, over_frames, skeletons
from analysis.figures.readings import DIFFERENCES, Reading
from analysis.figures.run_descriptions import accuracy, legs, setup
from analysis.figures.style import canvas, rows
from workbench.recording.read.reader import Run
from workbench.recording.study.drawing import SERIES

N_FRAMES = 6
"""As in the papers: frames 0, 10, …, 50 or 5, 10, …, 30."""
KEY = "Orange: expected pose; blue: truth; violet: particles."
SAME, ANOTHER = "of one motion", "of generated walkers, another for every seed"
INTERVALS = "Intervals: 95 %, bootstrap over seeds, {}."
"""Of a recorded motion every seed shows the same person; a generated walker is drawn by the seed."""


def tracked(title: str, readings: Reading, paper: str) -> Figure:
    """Draw for either reading images with the posterior's skeletons, the expected pose in space, and both errors."""
    caption = f"{KEY} {words({'': readings})} {paper} {DIFFERENCES}"
    figure = canvas(title, 3.6 * len(readings.runs) + 2.4, caption)
    titles = [line for reading in readings.runs for line in (readings.row(reading), "expected pose in space")]
    parts = rows(figure, [2.0, 1.6] * len(readings.runs) + [1.2], [*titles, ""])
    for above, below, run in zip(parts[0::2], parts[1::2], readings.runs.values(), strict=False):
        frames = evenly(run, N_FRAMES)
        images(above.subplots(1, len(frames)), run, frames)
        skeletons(below.subplots(1, len(frames)), run, frames)
    _errors(parts[-1], readings.runs)
    return figure


def compared(title: str, readings: Mapping[str, Reading], paper: str) -> Figure:
    """Draw a row of images for either reading of each experiment, named by its key, and their errors over frames."""
    n_rows = sum(len(each.runs) for each in readings.values())
    figure = canvas(title, 1.7 * n_rows + 2.9, f"{KEY} {words(readings)} {paper} {DIFFERENCES}")
    titles = [each.row(reading, label) for label, each in readings.items() for reading in each.runs]
    parts = rows(figure, [1.7] * n_rows + [1.3], [*titles, ""])
    runs = [run for each in readings.values() for run in each.runs.values()]
    for part, run in zip(parts, runs, strict=False):
        frames = evenly(run, N_FRAMES)
        images(part.subplots(1, len(frames)), run, frames)
    each_run = zip(((label, reading) for label, each in readings.items() for reading in each.runs), runs, strict=True)
    _errors(parts[-1], {f"{label}, {reading}": run for (label, reading), run in each_run})
    return figure


def fitted(title: str, readings: Reading, paper: str) -> Figure:
    """Draw the surface fitted to points, in frames from the first to the last, a row for either reading."""
    key = "Black: observed points; blue: true skeleton; solid: fit."
    angles = "; ".join(f"{reading}: {legs(run)}" for reading, run in readings.runs.items())
    caption = f"{key} {words({'': readings})} Flexion, {angles}. {paper} {DIFFERENCES}"
    figure = canvas(title, 1.7 * len(readings.runs) + 1.3, caption)
    parts = rows(figure, [1.0] * len(readings.runs), [readings.row(reading) for reading in readings.runs])
    for part, run in zip(parts, readings.runs.values(), strict=True):
        frames = evenly(run, 7)
        bodies(part.subplots(1, len(frames)), run, frames)
    return figure


def words(readings: Mapping[str, Reading]) -> str:
    """Return a description of the recordings with their results, and of the intervals in the rows."""
    descriptions = [
        f"{f'{label}, {reading}' if label else reading}: {setup(run)}; {accuracy(run)}"
        for label, each in readings.items()
        for reading, run in each.runs.items()
    ]
    sources = {ANOTHER if _drawn(run) else SAME for each in readings.values() for run in each.runs.values()}
    return f"Shown: {'. '.join(descriptions)}. {INTERVALS.format(' or '.join(sorted(sources, reverse=True)))}"


def _drawn(run: Run) -> bool:
    return run.settings["dataset"].get("motion") in ("builtin", "builtin_run")


def _errors(part: SubFigure, runs: Mapping[str, Run]) -> None:
    colours = dict(zip(runs, (*SERIES[2:], *SERIES[:2]), strict=False))
    over_frames(part.subplots(), runs, "mpjpe_px", "error (px)", colours)
