"""Paper C, fig. 3 (a) to (e): samples at four temperatures, and those for an arm that is tracked.

From temperature, from temperature_arm, whose database is of right arms, and from arm_implicit_waving, which tracks one.
The exact samples for that clip differ from the true continuation by 21° at the frame shown, in the angle of largest
error, the median of 50 samples, and in the following half second by 56° to 77°: the database has no such waving.
"""

from collections.abc import Mapping, Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection
from matplotlib.figure import Figure

from analysis.figures.frames import particles, scenes
from analysis.figures.readings import OURS, PaperFigure, Reading
from analysis.figures.run_descriptions import accuracy, setup
from analysis.figures.studies import AZIMUTH_DEG, ELEVATION_DEG, projected, sticks
from analysis.figures.style import bare, canvas
from workbench.core.study import Sticks
from workbench.recording.read.reader import Run
from workbench.recording.study.drawing import TRUTH

EXPERIMENTS = ("temperature", "temperature_arm", "arm_implicit_waving")
FRAME = 10
"""Of those tracked: that of temperature_arm's draws."""


def draw(readings: Mapping[str, Reading]) -> Figure:
    """Draw (a) to (d) by the paper's tree; (e) what follows the windows drawn for the arm's true history, and
    particles."""
    whole, arm, tracked = (readings[name].ours for name in EXPERIMENTS)
    draws = [*_of(whole, "sign tree"), *_of(arm, "sign tree"), *_of(arm, "our search")]
    frames = tracked.poses[0]
    frame = int(frames[min(FRAME, len(frames) - 1)])
    n_shown = len(particles(tracked, frame)) // max(1, len(scenes(tracked, [frame])[0].estimate))
    figure = canvas(
        "Paper C, fig. 3: draws from the database, and for a tracked arm",
        3.2,
        "Grey: ten poses drawn; blue: the pose that truly followed, or was. (a) to (d): the whole body, by the paper's "
        "tree. (e): the right arm alone, after a third of a second of its true motion, by the tree and by our search, "
        f"whose odds are exact, at β = 0.05; then {n_shown} particles of frame {frame}. Tracked: {setup(tracked)}, "
        f"β = {tracked.settings['prior']['beta']:g}, {accuracy(tracked)}. The clip is not in the database, though "
        "others of its data set are. The paper: (e) is a typical set of particles of its arm sequence, no numbers. Not "
        "the paper's: a rendered arm; its β unknown.",
    )
    cells = figure.subplots(1, len(draws) + 1)
    hot = [f"({letter}) β{drawn.name.rpartition('β')[2]}" for letter, drawn in zip("abcd", draws[:-2], strict=False)]
    for axes, drawn in zip(cells, draws, strict=False):
        sticks(axes, drawn)
    _particles(cells[-1], tracked, frame)
    for axes, title in zip(cells, (*hot, "(e) tree", "(e) exact", "(e) particles"), strict=True):
        axes.set_title(title, fontsize=7.5)
    return figure


def _of(run: Run, search: str) -> Sequence[Sticks]:
    """Return the draws by a search."""
    return [drawn for drawn in run.figures if isinstance(drawn, Sticks) and search in drawn.name]


def _particles(axes: Axes, run: Run, frame: int) -> None:
    """Draw particles and the truth, from the side that `sticks` shows the person from."""
    (scene,) = scenes(run, [frame])
    heading = float(run.poses[1][run.poses[0] == frame][0, run.properties["body"]["pose"].index("root_heading")])
    azimuth = np.degrees(heading) + AZIMUTH_DEG
    for lines, colour, width in ((particles(run, frame), "0.4", 0.4), (scene.truth, TRUTH, 1.4)):
        flat = list(projected(lines, azimuth, ELEVATION_DEG))
        axes.add_collection(LineCollection(flat, colors=colour, linewidths=width))
    axes.autoscale_view()
    bare(axes)


FIGURES = {"c_fig3_arm": PaperFigure(EXPERIMENTS, OURS, draw)}
