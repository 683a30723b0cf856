"""Paper C, fig. 5: two seconds of running made up by the implicit prior.

From synthesize_run: the clip that it starts from is not in the database.
"""

from collections.abc import Mapping

import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection
from matplotlib.figure import Figure

from analysis.figures.frames import scenes
from analysis.figures.readings import BOTH, Reading
from analysis.figures.studies import projected
from analysis.figures.style import bare, canvas, rows
from workbench.recording.read.reader import Run
from workbench.recording.study.drawing import SERIES

EXPERIMENTS = ("synthesize_run",)
READINGS = BOTH
EVERY = 3
TRAILS = {"left_wrist": SERIES[1], "right_wrist": SERIES[0]}


def draw(readings: Mapping[str, Reading]) -> Figure:
    """Draw for either reading every third pose in grey and the paths of both wrists, from the runner's right-hand
    side."""
    made = readings["synthesize_run"]
    runs = "; ".join(f"{reading}: {_description(run)}" for reading, run in made.runs.items())
    figure = canvas(
        "Paper C, fig. 5: running, made up",
        1.6 * len(made.runs) + 1.0,
        f"Grey: every third pose; orange and blue: left and right wrist. {runs} of the frames are drawn from clips of "
        "the same activity. As the paper writes it there is no smoothing, look-ahead or contact with the ground; β is "
        "ours. The paper: 2 s at 30 Hz; feet planted regularly. Not C's in either row: the database, CMU's and "
        "Bandai's without the clip that it starts from; place and heading enter it as increments in the body's own "
        "frame; the noise, of which C gives no numbers.",
    )
    parts = rows(figure, [1.0] * len(made.runs), [made.row(reading) for reading in made.runs])
    for part, run in zip(parts, made.runs.values(), strict=True):
        _motion(part.subplots(), run)
    return figure


def _description(run: Run) -> str:
    way = np.ptp(run.joints.positions[:, 0], axis=0)[:2]
    seconds = (len(run.joints.frames) - 1) / run.settings["dataset"]["rate_hz"]
    share = 100 * run.result["same_activity"]
    return f"{seconds:.1f} s, {np.hypot(*way):.1f} m, β = {run.settings['prior']['beta']:g}, {share:.0f} %"


def _motion(axes: Axes, run: Run) -> None:
    places = run.joints.positions
    heading = places[-1, 0, :2] - places[0, 0, :2]
    azimuth = float(np.degrees(np.arctan2(-heading[0], heading[1])))  # to the right of the way
    for scene in scenes(run, [int(frame) for frame in run.joints.frames[::EVERY]]):
        lines = list(projected(scene.estimate, azimuth, 8.0))
        axes.add_collection(LineCollection(lines, colors="0.6", linewidths=0.8))
    for name, colour in TRAILS.items():
        axes.plot(*projected(places[:, run.joints.names.index(name)], azimuth, 8.0).T, color=colour, linewidth=1.4)
    axes.autoscale_view()
    bare(axes)
