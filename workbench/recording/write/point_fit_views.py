"""What a fit to points is judged by: flexion of hips and knees against the truth, and the activity told (paper D)."""

from collections.abc import Sequence

import rerun as rr
import rerun.blueprint as rrb

from workbench.body.angles import FLEXIONS, flexions
from workbench.body.skeleton import Skeleton
from workbench.core.step import Step
from workbench.recording.write import colours
from workbench.recording.write.columns import Entities

FLEXION, ACTIVITY = "flexion", "activity"
_ROWS = (("estimate", colours.ESTIMATE, 4.0), ("truth", colours.TRUTH, 1.5))  # the viewer draws them in this order


def curves(skeleton: Skeleton, step: Step) -> dict[str, float]:
    """Return one frame's flexions by entity path, degrees, of the estimate and, where it is known, of the true pose."""
    poses, truth = {"estimate": step.expected_pose}, step.frame.truth
    if truth is not None and truth.pose is not None:
        poses["truth"] = truth.pose
    return {
        f"{FLEXION}/{name}/{row}": angle
        for row, pose in poses.items()
        for name, angle in flexions(skeleton, pose).items()
    }


def fixed(names: Sequence[str]) -> Entities:
    """Yield the styles of the curves of `names`, keys of FLEXIONS."""
    for name in names:
        for row, colour, width in _ROWS:
            yield f"{FLEXION}/{name}/{row}", rr.SeriesLines(colors=[colour], widths=[width], names=[row])


def activities(step: Step) -> Entities:
    """Yield the activity told and the true one, as lanes of a timeline."""
    truth = step.frame.truth
    for row, activity in (("estimate", step.activity), ("truth", None if truth is None else truth.activity)):
        if activity is not None:
            yield f"{ACTIVITY}/{row}", rr.StateChange(state=activity)


def views(names: Sequence[str]) -> rrb.Grid:
    """Lay out a plot for each of the flexions `names`, left and right side by side."""
    plots = [
        rrb.TimeSeriesView(
            origin=f"/{FLEXION}/{name}",
            name=f"{name.replace('_', ' ')} flexion (degrees)",
            plot_legend=rrb.PlotLegend(visible=False),  # the world's title says which colour is whose
        )
        for name in FLEXIONS
        if name in names
    ]
    return rrb.Grid(*plots, grid_columns=2, name="flexion")


def timeline() -> rrb.StateTimelineView:
    """Lay out the activities' lanes."""
    return rrb.StateTimelineView(origin=f"/{ACTIVITY}", name="activity")
