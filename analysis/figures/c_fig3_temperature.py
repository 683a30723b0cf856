"""Paper C, fig. 3: what the database gives for one probe at four temperatures.

From temperature: ten draws by the paper's sign tree and by our search, and how far both are from the exact odds.
"""

from collections.abc import Mapping
from dataclasses import replace

from matplotlib.figure import Figure

from analysis.figures.readings import OURS, Reading
from analysis.figures.studies import sticks
from analysis.figures.style import canvas, rows
from workbench.core.study import Curves, Sticks
from workbench.recording.study.drawing import draw_curves

EXPERIMENTS = ("temperature",)
READINGS = OURS


def draw(readings: Mapping[str, Reading]) -> Figure:
    """Draw the samples at rising temperatures, a row for each search; fidelity against temperature."""
    run = readings["temperature"].ours
    result = run.result
    draws = [figure for figure in run.figures if isinstance(figure, Sticks)]
    fidelity = [figure for figure in run.figures if isinstance(figure, Curves)]
    figure = canvas(
        "Paper C, fig. 3: sampling from the database",
        6.3,
        "Grey: ten poses drawn; blue: the pose that truly followed. Ours, at the prior's β: total variation to the "
        f"exact odds {result['tv_search']:.2g} by our search, which looks at {result['visited_pct']:.1f} % of the "
        f"database, {result['tv_sign_tree']:.2f} by the paper's tree. The paper shows cold draws alike and hot ones of "
        "any kind, without numbers.",
    )
    upper, lower = rows(figure, (3.6, 1.9), ("", ""))
    for axes, drawn in zip(upper.subplots(2, len(draws) // 2, sharex=True, sharey=True).flat, draws, strict=True):
        sticks(axes, drawn)
        axes.set_title(drawn.name.partition("/")[2])
    for axes, curves in zip(lower.subplots(1, len(fidelity)), fidelity, strict=True):
        marks = dict(zip(["prior"], curves.marks.values(), strict=False))  # whose longer name would cross curves
        draw_curves(axes, replace(curves, marks=marks), marks_at=0.72)
        axes.set_title(curves.name.partition("/")[2])
    return figure
