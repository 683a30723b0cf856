"""Paper D, section 4: the same points with a motion model, fitted and filtered.

From points_walk_steady, points_walk_variable, points_particle_filter and points_hybrid.
"""

from collections.abc import Mapping

from matplotlib.figure import Figure

from analysis.figures.readings import OURS, Reading
from analysis.figures.run_descriptions import setup
from analysis.figures.style import canvas
from workbench.recording.study.drawing import ESTIMATE

NAMES = {
    "points_particle_filter": "particle filter",
    "points_hybrid": "particle filter about the fit",
    "points_walk_steady": "fit, one style",
    "points_walk_variable": "fit, a style per frame",
}
EXPERIMENTS = tuple(NAMES)
READINGS = OURS


def draw(readings: Mapping[str, Reading]) -> Figure:
    """Draw errors in space and of the knees, and milliseconds a frame, a row for each method."""
    first = readings["points_walk_steady"].ours
    figure = canvas(
        "Paper D, section 4: fitting and filtering the same points",
        2.6,
        f"Ours: {setup(first)}; times are those of the machine that ran them. The paper gives no errors; it expects "
        "fitting to cost less than filtering (section 4.4) and suggests to combine both (section 1).",
    )
    columns = figure.subplots(1, 3, sharey=True)
    runs = [readings[experiment].ours for experiment in NAMES]
    values = {
        "joints off by (mm)": [run.result["mpjpe_abs_mm"] for run in runs],
        "knees off by (degrees)": [run.result["knee_flexion_rmse_deg"] for run in runs],
        "time (ms a frame)": [run.properties.get("cost", {}).get("ms_per_frame", float("nan")) for run in runs],
    }
    for axes, (name, row) in zip(columns, values.items(), strict=True):
        axes.barh(list(NAMES.values()), row, color=ESTIMATE, height=0.6)
        for y, value in enumerate(row):
            axes.annotate(
                f"{value:.{0 if value >= 100 else 1}f}",
                (value, y),
                (3.0, 0.0),
                textcoords="offset points",
                va="center",
                fontsize=7.5,
            )
        axes.set_xlabel(name)
        axes.margins(x=0.18)
    columns[0].invert_yaxis()
    return figure
