"""Paper D, fig. 6: flexion of hips and knees in the walk of fig. 5.

From points_walk_steady. The paper's reference is integrated gyroscopes; ours is the true pose.
"""

from collections.abc import Mapping

from matplotlib.figure import Figure

from analysis.figures.frames import flexions
from analysis.figures.panels import flexion
from analysis.figures.readings import BOTH, DIFFERENCES, Reading
from analysis.figures.run_descriptions import legs
from analysis.figures.sequences import words
from analysis.figures.style import canvas, rows

EXPERIMENTS = ("points_walk_steady",)
READINGS = BOTH
JOINTS = ("right_hip", "left_hip", "right_knee", "left_knee")


def draw(readings: Mapping[str, Reading]) -> Figure:
    """Draw a row for either reading: hips, then knees, each right leg first."""
    walk = readings["points_walk_steady"]
    descriptions = "; ".join(f"{reading}: {legs(run)}" for reading, run in walk.runs.items())
    figure = canvas(
        "Paper D, fig. 6: flexion of hips and knees",
        1.7 * len(walk.runs) + 1.7,
        f"Orange: fit; blue, thick: truth. {words({'': walk})} Flexion, {descriptions}. The paper: “very close” to the "
        f"gyroscopes, even though the left leg is mostly hidden; no errors given. {DIFFERENCES}",
    )
    parts = rows(figure, [1.0] * len(walk.runs), [walk.row(reading) for reading in walk.runs])
    for part, run in zip(parts, walk.runs.values(), strict=True):
        angles = flexions(run)
        for axes, joint in zip(part.subplots(1, len(JOINTS), sharey=True), JOINTS, strict=True):
            flexion(axes, angles[joint], joint.replace("_", " "))
            axes.label_outer()
    return figure
