"""Paper D, fig. 10: a walk that becomes a run.

From points_transition: two concatenated clips that are not in the training data; the activity is estimated frame by
frame.
"""

from collections.abc import Mapping

from matplotlib.figure import Figure

from analysis.figures.frames import activities
from analysis.figures.panels import activity_lanes, bodies, evenly
from analysis.figures.readings import BOTH, DIFFERENCES, Reading
from analysis.figures.sequences import words
from analysis.figures.style import canvas, rows

EXPERIMENTS = ("points_transition",)
READINGS = BOTH


def draw(readings: Mapping[str, Reading]) -> Figure:
    """Draw for either reading the fit in frames from the first to the last, with the estimated and the true
    activity."""
    both = readings["points_transition"]
    accuracies = {reading: run.result["activity_accuracy"] for reading, run in both.runs.items()}
    shares = ", ".join(f"{reading} {100 * accuracy:.0f} %" for reading, accuracy in accuracies.items())
    figure = canvas(
        "Paper D, fig. 10: from walking to running",
        2.5 * len(both.runs) + 1.6,
        f"Black: observed points; blue: true skeleton; solid: fit. {words({'': both})} The activity is correct in "
        f"{shares} of the frames. The paper: four frames of walking, three of transition, then running; it gives no "
        f"activities. {DIFFERENCES}",
    )
    titles = [line for reading in both.runs for line in (both.row(reading), "")]
    parts = rows(figure, (1.7, 0.75) * len(both.runs), titles)
    for above, below, run in zip(parts[0::2], parts[1::2], both.runs.values(), strict=True):
        frames = evenly(run, 8)
        bodies(above.subplots(1, len(frames)), run, frames)
        activity_lanes(below.subplots(), run, activities(run))
    return figure
