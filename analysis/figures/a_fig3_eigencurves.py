"""Paper A, fig. 3: learning a walking model; walking cycles, their mean, and the eigencurves of the left knee.

From learn_walk. As in the paper's 3c a component is drawn alone and scaled by its deviation λ.
"""

from collections.abc import Mapping

from matplotlib.figure import Figure

from analysis.figures.readings import OURS, Reading
from analysis.figures.studies import curves_named
from analysis.figures.style import canvas
from workbench.core.study import Curves
from workbench.recording.study.drawing import draw_curves

EXPERIMENTS = ("learn_walk",)
READINGS = OURS
ANGLE = "left knee flexion"


def draw(readings: Mapping[str, Reading]) -> Figure:
    """Draw cycles and mean; the first three eigencurves; the variance explained."""
    run = readings["learn_walk"].ours
    result = run.result
    figure = canvas(
        "Paper A, fig. 3: learning a walking model",
        2.7,
        f"Ours: {result['n_components']:.0f} components explain 95 % of the variance of {result['n_cycles']:.0f} "
        f"cycles (five: {100 * result['explained_variance_5']:.0f} %), cut at gait events. "
        "The paper: five components, 13 cycles of 4 people, cut by hand.",
    )
    cycles, modes, shares = figure.subplots(1, 3)
    draw_curves(cycles, curves_named(run, f"cycles/{ANGLE}"))
    cycles.set_title(f"(a, b) {ANGLE}")
    draw_curves(modes, alone(curves_named(run, f"eigencurves/{ANGLE}")), dashed=True)
    modes.axhline(0.0, color="0.8", linewidth=0.6, zorder=0)
    modes.set_title("(c) eigencurves, times λ")
    draw_curves(shares, curves_named(run, "model/explained variance"), marks_at=0.5)
    shares.set_title("variance explained")
    shares.set_ylim(0.0, 1.02)
    return figure


def alone(eigencurves: Curves) -> Curves:
    """Return λ_k times component k, of the recorded mean + 2 λ_k times component k."""
    mean = eigencurves.curves["mean"]
    modes = {f"{k}": 0.5 * (curve - mean) for k, curve in enumerate(list(eigencurves.curves.values())[1:], start=1)}
    return Curves(eigencurves.name, eigencurves.x, modes, eigencurves.x_name, eigencurves.y_name)
