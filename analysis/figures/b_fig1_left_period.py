"""Paper B, fig. 1 left: signal-to-noise ratio over the candidate period.

From period_snr. The axis is logarithmic, where the paper's is linear: single angles differ by powers of ten.
"""

from collections.abc import Mapping

from matplotlib.figure import Figure

from analysis.figures.readings import OURS, Reading
from analysis.figures.style import canvas
from workbench.recording.study.drawing import draw as draw_figure

EXPERIMENTS = ("period_snr",)
READINGS = OURS


def draw(readings: Mapping[str, Reading]) -> Figure:
    """Draw the walk whose period was found best, all walks with white noise, and the deviations from hip events."""
    run = readings["period_snr"].ours
    result = run.result
    figure = canvas(
        "Paper B, fig. 1 left: finding the period",
        2.9,
        f"Ours: {result['n_clips']:.0f} walks; periods differ from hip events by "
        f"{result['period_error_median_pct']:.2f} % (median) and {result['period_error_max_pct']:.1f} % at most; white "
        f"noise stays flat: its largest ratio is {result['white_noise_peak_ratio']:.2f} times its median. The paper: a "
        "peak at 126 samples; white noise about constant.",
    )
    first, second, third = figure.subplots(1, 3)
    figures = run.figures
    for axes, drawn in zip((first, second, third), (figures[0], *figures[-2:]), strict=True):
        draw_figure(axes, drawn)
        axes.set_title(drawn.name.partition("/")[2])
    return figure
