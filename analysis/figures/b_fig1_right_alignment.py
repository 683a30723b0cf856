"""Paper B, fig. 1 right: walks aligned to one another.

From align_cycles: every walk folded by its own period, as it begins, and shifted to deviate least from one spline.
"""

from collections.abc import Mapping

from matplotlib.figure import Figure

from analysis.figures.readings import OURS, Reading
from analysis.figures.studies import curves_named
from analysis.figures.style import canvas
from workbench.recording.study.drawing import draw_curves

EXPERIMENTS = ("align_cycles",)
READINGS = OURS
ANGLES = ("left hip flexion", "left knee flexion", "left shoulder flexion")


def draw(readings: Mapping[str, Reading]) -> Figure:
    """Draw three angles before, above, and after, below."""
    run = readings["align_cycles"].ours
    result = run.result
    figure = canvas(
        "Paper B, fig. 1 right: aligning walks",
        4.4,
        f"Ours: {result['n_sequences']:.0f} walks (grey), their mean and, once aligned, their common spline (blue), "
        f"from which they deviate by {result['deviation_before']:.2f} standard deviations of the angles before and "
        f"{result['deviation_after']:.2f} after {result['n_passes']:.0f} passes. The paper shows eight walks and gives "
        "no number.",
    )
    for row, when in zip(figure.subplots(2, len(ANGLES), sharex=True), ("before", "after"), strict=True):
        for axes, angle in zip(row, ANGLES, strict=True):
            draw_curves(axes, curves_named(run, f"alignment/{angle} {when}"), labels=False)
            axes.set_title(f"{angle}, {when}")
    return figure
