"""Paper C, fig. 5 and section 5: motions made up by the implicit prior, and changes from one to another."""

from collections import Counter
from collections.abc import Mapping
from itertools import groupby

import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection
from matplotlib.figure import Figure

from analysis.figures.frames import activities, scenes
from analysis.figures.readings import BOTH, OURS, PaperFigure, Reading
from analysis.figures.studies import projected
from analysis.figures.style import bare, canvas, rows
from workbench.recording.read.reader import Run
from workbench.recording.study.drawing import FAINT, SERIES

EVERY = 3
TRAILS = {"left_wrist": SERIES[1], "right_wrist": SERIES[0]}
MADE = {
    "synthesize_walk": "walking",
    "synthesize_run": "running",
    "synthesize_wave": "waving",
    "synthesize_dance": "dancing, its only clip in the database",
    "synthesize_punch": "after a punch",
    "synthesize_walk_or_run": "after a walk, of walks and runs, β = 1",
    "synthesize_run_to_walk": "after a run, of walks and runs, β = 1",
    "synthesize_walk_to_run": "after a walk, of runs alone",
}
N_SHOWN, SPACING_M, MOST_CHANGES = 11, 0.85, 4


def running(readings: Mapping[str, Reading]) -> Figure:
    """Draw for either reading every third pose in grey and the paths of both wrists, from the runner's right-hand
    side."""
    made = readings["synthesize_run"]
    runs = "; ".join(f"{reading}: {_run_description(run)}" for reading, run in made.runs.items())
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
        _run_motion(part.subplots(), run)
    return figure


def _run_description(run: Run) -> str:
    way = np.ptp(run.joints.positions[:, 0], axis=0)[:2]
    seconds = (len(run.joints.frames) - 1) / run.settings["dataset"]["rate_hz"]
    share = 100 * run.result["same_activity"]
    return f"{seconds:.1f} s, {np.hypot(*way):.1f} m, β = {run.settings['prior']['beta']:g}, {share:.0f} %"


def _run_motion(axes: Axes, run: Run) -> None:
    places = run.joints.positions
    azimuth = _azimuth_deg(run)
    for scene in scenes(run, [int(frame) for frame in run.joints.frames[::EVERY]]):
        lines = list(projected(scene.estimate, azimuth, 8.0))
        axes.add_collection(LineCollection(lines, colors="0.6", linewidths=0.8))
    for name, colour in TRAILS.items():
        axes.plot(*projected(places[:, run.joints.names.index(name)], azimuth, 8.0).T, color=colour, linewidth=1.4)
    axes.autoscale_view()
    bare(axes)


def other_motions(readings: Mapping[str, Reading]) -> Figure:
    """Draw a row of poses each, from the right-hand side, moved apart evenly, with speed and the activity drawn
    from."""
    runs = {name: readings[name].ours for name in MADE}
    betas = ", ".join(sorted({f"{run.settings['prior']['beta']:g}" for run in runs.values()}))
    figure = canvas(
        "Paper C, section 5: other motions made up, and changes between them",
        1.25 * len(runs) + 1.2,
        f"Of each {N_SHOWN} frames from first to last, moved apart; speeds of the first and last half second; how many "
        "frames were drawn from clips of which activity, in their order, which is the colour. β = "
        f"{betas}, ours. The clip that a motion starts from is not in the database, but for the dance, which replays "
        "it; the database has every activity where none is named. The paper shows running alone (fig. 5) and says that "
        "a motion's kind is controlled by its start, that β controls the probability of changing it, and that smooth "
        "changes need a larger database. Not the paper's: smoothing, look-ahead, contact with the ground.",
    )
    parts = rows(figure, [1.0] * len(runs), [f"{MADE[name]}: {_description(run)}" for name, run in runs.items()])
    names = dict.fromkeys(name for run in runs.values() for name in _drawn(run).values())
    colours = {name: SERIES[k % len(SERIES)] for k, name in enumerate(names)}
    for part, run in zip(parts, runs.values(), strict=True):
        _motion(part.subplots(), run, colours)
    return figure


def _drawn(run: Run) -> Mapping[int, str]:
    """Return the activity drawn from in every frame; none where it was not recorded."""
    return activities(run).get("estimate", {})


def _description(run: Run) -> str:
    """Return speeds of the first and last half second, and the activities drawn from, in order, with their frames."""
    ways = np.linalg.norm(np.diff(run.joints.positions[:, 0, :2], axis=0), axis=1)
    speeds = ways * run.settings["dataset"]["rate_hz"]
    n = max(1, min(15, len(speeds) // 2))
    orders = [(name, len(list(frames))) for name, frames in groupby(_drawn(run).values())]
    changes = ", ".join(f"{name} {n_frames}" for name, n_frames in orders)
    if len(orders) > MOST_CHANGES:
        counts = Counter(_drawn(run).values())
        changes = ", ".join(f"{name} {n}" for name, n in counts.items()) + f", changing {len(orders) - 1} times"
    jump = f", jumps {run.result['jump_deg_p99']:.0f}°" if "jump_deg_p99" in run.result else ""
    return f"{speeds[:n].mean():.1f} to {speeds[-n:].mean():.1f} m/s{jump}; {changes or 'activity unknown'}"


def _motion(axes: Axes, run: Run, colours: Mapping[str, str]) -> None:
    """Draw poses in a row, each about its pelvis, at its own height."""
    frames, positions, drawn = run.joints.frames, run.joints.positions, _drawn(run)
    rows_shown = np.unique(np.linspace(0, len(frames) - 1, N_SHOWN).round().astype(int))
    azimuth = _azimuth_deg(run)
    for k, scene in enumerate(scenes(run, [int(frames[row]) for row in rows_shown])):
        middle = np.array([*positions[rows_shown[k], 0, :2], 0.0])
        lines = projected(scene.estimate - middle, azimuth, 0.0) + np.array([SPACING_M * k, 0.0])
        axes.add_collection(
            LineCollection(list(lines), colors=colours.get(drawn.get(scene.frame, ""), "0.4"), linewidths=1.2)
        )
    axes.axhline(0.0, color=FAINT, linewidth=0.6, zorder=0)
    axes.autoscale_view()
    bare(axes)


def _azimuth_deg(run: Run) -> float:
    """Return the azimuth from the right of the way from the first to the last place."""
    places = run.joints.positions[[0, -1], 0, :2]
    x, y = places[1] - places[0]
    return float(np.degrees(np.arctan2(-x, y)))


FIGURES = {
    "c_fig5_running": PaperFigure(("synthesize_run",), BOTH, running),
    "c_synthesis": PaperFigure(tuple(MADE), OURS, other_motions),
}
