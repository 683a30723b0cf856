"""Paper C, section 5: other motions than running made up by the implicit prior, and changes from one to another.

From synthesize_run and its variants synthesize_walk, synthesize_wave, synthesize_dance, synthesize_punch,
synthesize_walk_or_run, synthesize_run_to_walk and synthesize_walk_to_run.
"""

from collections import Counter
from collections.abc import Mapping
from itertools import groupby

import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection
from matplotlib.figure import Figure

from analysis.figures.frames import activities, scenes
from analysis.figures.readings import OURS, Reading
from analysis.figures.studies import projected
from analysis.figures.style import bare, canvas, rows
from workbench.recording.read.reader import Run
from workbench.recording.study.drawing import FAINT, SERIES

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
EXPERIMENTS = tuple(MADE)
READINGS = OURS
N_SHOWN, SPACING_M, MOST_CHANGES = 11, 0.85, 4


def draw(readings: Mapping[str, Reading]) -> Figure:
    """Draw a row of poses each, from the right-hand side, moved apart evenly, with speed and the activity drawn
    from."""
    runs = {name: readings[name].ours for name in EXPERIMENTS}
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
    way = positions[-1, 0, :2] - positions[0, 0, :2]
    azimuth = float(np.degrees(np.arctan2(-way[0], way[1])))
    for k, scene in enumerate(scenes(run, [int(frames[row]) for row in rows_shown])):
        middle = np.array([*positions[rows_shown[k], 0, :2], 0.0])
        lines = projected(scene.estimate - middle, azimuth, 0.0) + np.array([SPACING_M * k, 0.0])
        axes.add_collection(
            LineCollection(list(lines), colors=colours.get(drawn.get(scene.frame, ""), "0.4"), linewidths=1.2)
        )
    axes.axhline(0.0, color=FAINT, linewidth=0.6, zorder=0)
    axes.autoscale_view()
    bare(axes)
