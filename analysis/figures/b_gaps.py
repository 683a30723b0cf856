"""Paper B, section 2.2: missing joint angles filled in, by method.

From impute_gaps. The paper gives no errors; its plain algorithm is one of the methods.
"""

from collections.abc import Mapping

from matplotlib.figure import Figure

from analysis.figures.readings import OURS, Reading
from analysis.figures.studies import figure_named
from analysis.figures.style import canvas
from workbench.recording.study.drawing import draw as draw_figure

EXPERIMENTS = ("impute_gaps",)
READINGS = OURS


def draw(readings: Mapping[str, Reading]) -> Figure:
    """Draw error over the part removed, in blocks and by markers; one angle of one walk with its gaps."""
    run = readings["impute_gaps"].ours
    result = run.result
    figure = canvas(
        "Paper B, section 2.2: filling in missing joint angles",
        3.0,
        f"At 20 % of the samples removed in blocks: ours {result['rmse_deg_20']:.2f}°, the paper's algorithm "
        f"{result['rmse_deg_20_paper']:.2f}°, a periodic spline {result['rmse_deg_20_periodic']:.2f}°, linear "
        f"interpolation {result['rmse_deg_20_linear']:.2f}° (root mean square). The paper gives no errors.",
    )
    blocks, markers = figure.subplots(1, 2)
    for axes, name in ((blocks, "gaps/blocks removed"), (markers, "gaps/markers removed")):
        draw_figure(axes, figure_named(run, name))
        axes.set_title(name.partition("/")[2])
        axes.set_ylim(bottom=0.0)
    return figure
