"""Paper D, fig. 6: flexion of hips and knees in the walk of fig. 5.

From points_walk_steady. The paper's reference is integrated gyroscopes; ours is the true pose.
"""

from collections.abc import Mapping

from matplotlib.figure import Figure

from analysis.figures.frames import flexions
from analysis.figures.panels import flexion
from analysis.figures.style import canvas
from analysis.figures.told import legs, setup
from workbench.recording.read.reader import Run

EXPERIMENTS = ("points_walk_steady",)
JOINTS = ("right_hip", "left_hip", "right_knee", "left_knee")


def draw(runs: Mapping[str, Run]) -> Figure:
    """Right leg on the left, left leg on the right, hips above knees, as in the paper."""
    run = runs["points_walk_steady"]
    figure = canvas(
        "Paper D, fig. 6: flexion of hips and knees",
        3.9,
        f"Orange: fit; blue, thick: truth. Ours: {setup(run)}; {legs(run)}. The paper: “very close” to the gyroscopes, "
        "even though the left leg is mostly hidden; no errors given.",
    )
    found = flexions(run)
    for axes, joint in zip(figure.subplots(2, 2, sharex=True, sharey="row").flat, JOINTS, strict=True):
        flexion(axes, found[joint], joint.replace("_", " "))
        axes.label_outer()
    return figure
