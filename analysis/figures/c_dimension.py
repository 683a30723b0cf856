"""Paper C, section 6: particles needed against the number of parameters, N ∝ 1/α^d.

From particles_by_dimension. The paper has two numbers of particles and no figure.
"""

from collections.abc import Mapping

import numpy as np
from matplotlib.figure import Figure

from analysis.figures.readings import OURS, PaperFigure, Reading
from analysis.figures.studies import curves_named
from analysis.figures.style import canvas
from workbench.core.study import Curves
from workbench.evaluation.uncertainty.intervals import bootstrap_interval
from workbench.recording.study.drawing import GREY, SERIES, label_ends


def draw(readings: Mapping[str, Reading]) -> Figure:
    """Draw mean log N over d with intervals over seeds, and the line of the paper's two numbers."""
    run = readings["particles_by_dimension"].ours
    result, drawn = run.result, curves_named(run, "particles/needed")
    figure = canvas("Paper C, section 6: particles against dimension", 3.9, _caption(result, _n_seeds(drawn)))
    axes = figure.subplots()
    ends = []
    for (label, curve), colour in zip(drawn.curves.items(), SERIES, strict=False):
        finite = np.isfinite(curve)
        seeds = np.array([row for name, row in drawn.faint.items() if name.startswith(f"{label}, seed")])
        if len(seeds):
            low, high = bootstrap_interval(seeds[:, finite], np.random.default_rng(0))
            off = np.abs(np.stack([curve[finite] - low, high - curve[finite]]))
            axes.errorbar(drawn.x[finite], curve[finite], off, color=colour, marker="o", markersize=3.0, capsize=2.0)
        else:
            axes.plot(drawn.x, curve, color=GREY, linestyle=(0, (4, 3)))
            colour = GREY
        ends.append((label, colour, float(drawn.x[finite][-1]), float(curve[finite][-1])))
    axes.set_xlabel(drawn.x_name)
    axes.set_ylabel(drawn.y_name)
    axes.set_ylim(bottom=0.0)
    axes.margins(x=0.02)
    label_ends(axes, ends, gap=0.07)
    return figure


def _n_seeds(drawn: Curves) -> int:
    return len({name.rpartition(" ")[2] for name in drawn.faint})


def _caption(result: Mapping[str, float], n_seeds: int) -> str:
    def alpha(name: str) -> str:
        low, high = (result[f"alpha_{name}_{end}"] for end in ("low", "high"))
        return f"{result[f'alpha_{name}']:.2f} ({low:.2f} to {high:.2f})"

    return (
        f"Means and 95 % intervals, {n_seeds} seeds. Particles of which one survives a frame: independent angles of "
        f"constant velocity, α = {alpha('independent')} an angle, exactly {result['alpha_exact']:.2f}; joints seen by "
        f"one camera under the smooth prior, {alpha('body')}, of arms {alpha('body_arms')}, then legs "
        f"{alpha('body_legs')}. Independent angles within half a standard deviation of the Kalman filter: after "
        f"one frame α = {alpha('one_frame')}, as survival says; after all ten {alpha('error')}, as each starts from "
        "what the one before got wrong. So the law holds, for angles that are alike, with an α that falls with the "
        "time; a body's angles differ, and it holds on average over limbs. The paper: 3000 particles for 8 parameters, "
        f"10¹⁶ for 50, which lie on α = {result['alpha_paper']:.2f} an angle, that is two parameters. Not the paper's: "
        "places of joints with noise of 8 px in place of images, and truths drawn from the prior that tracks them."
    )


FIGURES = {"c_dimension": PaperFigure(("particles_by_dimension",), OURS, draw)}
