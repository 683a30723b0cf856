"""Paper C, fig. 5: two seconds of running made up by the implicit prior.

From synthesize_run: the clip that it starts from is not in the database.
"""

from collections.abc import Mapping

import numpy as np
from matplotlib.collections import LineCollection
from matplotlib.figure import Figure

from analysis.figures.frames import scenes
from analysis.figures.studies import seen
from analysis.figures.style import bare, canvas
from workbench.recording.read.reader import Run
from workbench.recording.study.drawing import SERIES

EXPERIMENTS = ("synthesize_run",)
EVERY = 3
TRAILS = {"left_wrist": SERIES[1], "right_wrist": SERIES[0]}


def draw(runs: Mapping[str, Run]) -> Figure:
    """Every third pose in grey, the paths of both wrists, from the runner's right-hand side."""
    run = runs["synthesize_run"]
    way = np.ptp(run.joints.positions[:, 0], axis=0)[:2]
    seconds = (len(run.joints.frames) - 1) / run.settings["dataset"]["rate_hz"]
    figure = canvas(
        "Paper C, fig. 5: running, made up",
        2.2,
        f"Grey: every third pose; orange and blue: left and right wrist. Ours: {seconds:.1f} s, "
        f"{np.hypot(*way):.1f} m, β = {run.settings['prior']['beta']:g}; "
        f"{100 * run.result['same_activity']:.0f} % of the frames drawn from clips of the same activity. The paper: "
        "2 s at 30 Hz; feet planted regularly.",
    )
    axes = figure.subplots()
    places = run.joints.positions
    heading = places[-1, 0, :2] - places[0, 0, :2]
    azimuth = float(np.degrees(np.arctan2(-heading[0], heading[1])))  # to the right of the way
    for scene in scenes(run, [int(frame) for frame in run.joints.frames[::EVERY]]):
        lines = list(seen(scene.estimate, azimuth, 8.0))
        axes.add_collection(LineCollection(lines, colors="0.6", linewidths=0.8))
    for name, colour in TRAILS.items():
        axes.plot(*seen(places[:, run.joints.names.index(name)], azimuth, 8.0).T, color=colour, linewidth=1.4)
    axes.autoscale_view()
    bare(axes)
    return figure
