"""A recording of an estimated and a true skeleton, and the error of their joints, without a run."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np
import rerun as rr
import rerun.blueprint as rrb

from workbench.body.shape import from_height
from workbench.body.skeleton import person_skeleton
from workbench.recording.write import styles
from workbench.recording.write.columns import nanoseconds
from workbench.recording.write.file import written_file
from workbench.recording.write.layout import page
from workbench.recording.write.scene import ESTIMATE, TRUTH
from workbench.utils.arrays import FloatArray

_ERROR = "error_mm"
_EYE_M = (1.6, -1.6, 0.5)
"""From the person to the eye, about 2.3 m away, at which a person fills half of the view's height."""


def write_two_skeletons(
    path: Path, names: Sequence[str], times_s: FloatArray, estimate: FloatArray, truth: FloatArray
) -> None:
    """Write an .rrd with both skeletons in 3-D and the curve of their mean distance; an existing file is replaced.

    Parameters
    ----------
    names : of the J joints, of JOINT_NAMES.
    times_s : (F,), s.
    estimate, truth : (F, J, 3), m, NaN where missing.
    """
    path.parent.mkdir(parents=True, exist_ok=True)
    skeleton = person_skeleton(from_height(1.0))
    bones = [[skeleton.names[joint] for joint in bone] for bone in skeleton.bones]
    pairs = [[names.index(a), names.index(b)] for a, b in bones if a in names and b in names]
    person = np.nanmean(truth[np.isfinite(truth).any(axis=(1, 2))][0], axis=0)
    eye = rrb.EyeControls3D(
        position=person + _EYE_M, look_target=person, eye_up=[0.0, 0.0, 1.0], tracking_entity=f"/{TRUTH}/skeleton"
    )
    views = (
        rrb.Spatial3DView(origin="/world", name="estimate (orange) and truth (blue)", eye_controls=eye),
        rrb.TimeSeriesView(origin=f"/{_ERROR}", name="mean distance of the joints, mm"),
    )
    layout = page(rrb.Vertical(*views, row_shares=[3.0, 1.0]))
    distances = np.linalg.norm(estimate - truth, axis=-1)
    known = np.isfinite(distances)
    with written_file(path, "workbench_evaluation", path.stem, layout) as stream:
        stream.log("world", rr.ViewCoordinates.RIGHT_HAND_Z_UP, static=True)
        for k, time_s in enumerate(times_s.tolist()):
            stream.set_time("frame", sequence=k)
            stream.set_time("time", duration=nanoseconds(time_s))
            for entity, places, colour in ((ESTIMATE, estimate[k], styles.ESTIMATE), (TRUTH, truth[k], styles.TRUTH)):
                width = rr.Radius.ui_points(2.0)
                strips = [places[pair] for pair in pairs if np.isfinite(places[pair]).all()]
                stream.log(f"{entity}/skeleton", rr.LineStrips3D(strips, colors=[colour], radii=width))
            if known[k].any():
                stream.log(_ERROR, rr.Scalars(1e3 * float(distances[k][known[k]].mean())))
