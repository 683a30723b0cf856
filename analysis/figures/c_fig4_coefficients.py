"""Paper C, fig. 4: how the coefficients of what is drawn for one probe spread.

From coefficient_histograms: 1000 draws at β = 1, by the paper's sign tree and by our search.
"""

from collections.abc import Mapping

from matplotlib.figure import Figure

from analysis.figures.readings import OURS, Reading
from analysis.figures.style import canvas
from workbench.core.study import Bars
from workbench.recording.study.drawing import draw_bars

EXPERIMENTS = ("coefficient_histograms",)
READINGS = OURS


def draw(readings: Mapping[str, Reading]) -> Figure:
    """Draw a row for each search, a column for each coefficient."""
    run = readings["coefficient_histograms"].ours
    histograms = [figure for figure in run.figures if isinstance(figure, Bars)]
    figure = canvas(
        "Paper C, fig. 4: coefficients of the windows drawn for one probe",
        3.9,
        "Solid: draws; dashed: the independent Gaussian about the probe; TV: total variation between them (drawing as "
        f"often from the Gaussian itself would give {run.result['tv_sampling']:.2f}). The paper's histograms, of the "
        "sign tree, follow the Gaussian roughly; no numbers given.",
    )
    for axes, histogram in zip(figure.subplots(2, len(histograms) // 2).flat, histograms, strict=True):
        draw_bars(axes, histogram)
        search, _, coefficient = histogram.name.partition("/")[2].rpartition(", ")
        metric = f"tv_{coefficient}_{'sign_tree' if search == 'sign tree' else 'search'}"
        axes.set_title(f"{search}, {coefficient}: TV {run.result[metric]:.2f}")
        axes.set_yticks([])
    return figure
