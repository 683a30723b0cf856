"""`workbench export`: export the motion of a recording to a file."""

import logging
import sys
from dataclasses import replace
from pathlib import Path
from typing import Annotated

import numpy as np
import typer

from workbench.body.kinematics import joints, undetermined
from workbench.body.skeleton import Skeleton
from workbench.cameras.observed_joints import MIN_WEIGHT
from workbench.experiment.config.options import options
from workbench.motion.formats.motion_export import Track, check_output, export, with_missing_frames
from workbench.recording.read.chunks import timed
from workbench.recording.read.crash_probe import read_sound_run
from workbench.recording.read.keypoints import keypoint_weights
from workbench.recording.read.person import recorded_poses, recorded_skeleton
from workbench.recording.read.reader import Run
from workbench.recording.read.states import joints_below
from workbench.results.overlay import SUFFIX, write_overlay
from workbench.utils.arrays import BoolArray, FloatArray, IntArray
from workbench.utils.errors import InputError

log = logging.getLogger(__name__)

_Y_UP = "y is up, z ahead where the world has x"
_OPENSIM = "y is up, x ahead where the world has x, as in OpenSim's models"
_Z_UP = "z is up, as in the workbench"
_WITHOUT_GAPS = (".bvh", ".mot")
_AXES = {".bvh": _Y_UP, ".trc": _OPENSIM, ".csv": _Z_UP, ".c3d": _Z_UP, ".mot": _OPENSIM}


def export_recording(
    recording: Annotated[
        Path, typer.Argument(metavar="RUN.rrd", help="A recording, or the .part of an interrupted run.")
    ],
    output: Annotated[
        Path, typer.Option("-o", "--output", metavar="FILE", help="A .bvh, .trc, .csv, .c3d, .mot or .mp4 file.")
    ],
    truth: Annotated[
        bool, typer.Option("--truth", help="Export the true joints instead of the estimate (.trc, .c3d and .csv).")
    ] = False,
    metres: Annotated[bool, typer.Option("--metres", help="Lengths in m, not cm (BVH) or mm (TRC, C3D).")] = False,
    intervals: Annotated[bool, typer.Option("--intervals", help="Include the 90 % credible intervals (.csv).")] = False,
    camera: Annotated[str | None, typer.Option(metavar="NAME", help="Camera of the video; default: the first.")] = None,
    min_state: Annotated[
        str | None,
        typer.Option(
            metavar="tracked|doubtful", help="Leave out parts of the body with a lower state (.trc, .c3d, .csv, .mp4)."
        ),
    ] = None,
) -> None:
    """Export the motion of a recording for Blender (.bvh), OpenSim (.trc, .mot), gait analysis (.c3d) or a spreadsheet
    (.csv).

    A .mot file has joint angles in degrees, by the names of OpenSim's models.
    An .mp4 file shows the estimated skeleton over the images.

    Examples:
      workbench export run.rrd -o walk.bvh
      workbench export run.rrd -o walk.csv --intervals
      workbench export run.rrd -o overlay.mp4
      workbench export run.rrd -o tracked.trc --min-state tracked
    """
    if output.suffix.lower() == SUFFIX:
        n_frames, has_truth = write_overlay(read_sound_run(recording), output, camera, min_state=min_state)
        print(f"{output}: {n_frames} frames; left cyan, right pink{', truth blue' if has_truth else ''}")
        return
    check_output(output)  # before reading the recording
    if min_state is not None and output.suffix.lower() in _WITHOUT_GAPS:
        raise InputError(f"{output}: --min-state: its angles cannot be left out; choose .trc, .c3d, .csv or .mp4")
    run = read_sound_run(recording)
    track = true_track(run) if truth else estimated_track(run)
    if intervals:
        track = replace(track, bands=_intervals(run, track.frames))
    if min_state is not None:
        track = without_joints(track, joints_below(run.path, track.frames.tolist(), min_state, track.skeleton.names))
    export(output, with_missing_frames(track), metres=metres)
    if (n_omitted := len(run.poses[0]) - len(track)) > 0:
        print(f"{run.path}: {n_omitted} frames without ground truth are omitted", file=sys.stderr)
    if run.status != "complete":
        print(f"{run.path}: the run is not complete (status: {run.status})", file=sys.stderr)
    span = f"{len(track)} frames, {track.times_s[0]:.3f} to {track.times_s[-1]:.3f} s"
    print(f"{output}: {span}; {_AXES[output.suffix.lower()]}")


def estimated_track(run: Run) -> Track:
    """Return the estimated motion of a recording, NaN for joints that its keypoints never show, which are logged.

    Raises InputError if there is none, or for another body.
    """
    skeleton = _skeleton(run, "with poses")
    frames, times_s, poses = recorded_poses(run, skeleton)
    positions = joints(skeleton, poses)
    free_joints, free = _never_shown(run, skeleton)
    positions[:, free_joints] = np.nan
    if free_joints.any():
        listed = ", ".join(np.array(skeleton.names)[free_joints])
        log.warning(
            "%s: no keypoint shows %s in any frame: empty in TRC, CSV, C3D and MOT, assumed by the motion model in BVH",
            run.path, listed,
        )  # fmt: skip
    return Track(
        skeleton, frames, times_s, positions, poses, undetermined=tuple(np.array(skeleton.dof_names)[free].tolist())
    )


def without_joints(track: Track, hidden: BoolArray) -> Track:
    """Return a track without joints (F, J), and without the parameters of its poses that they determine."""
    positions = np.where(hidden[:, :, None], np.nan, track.positions)
    if track.poses is None:
        return replace(track, positions=positions)
    patterns, of_frame = np.unique(hidden, axis=0, return_inverse=True)
    free = np.array([undetermined(track.skeleton, ~pattern)[1] for pattern in patterns])
    return replace(track, positions=positions, poses=np.where(free[of_frame.ravel()], np.nan, track.poses))


def _never_shown(run: Run, skeleton: Skeleton) -> tuple[BoolArray, BoolArray]:
    """Return the joints (J,) and parameters (P,) that no keypoint of a recording determines; none where a likelihood
    of images or points determines them."""
    try:
        likelihood = run.settings.get("likelihood")
    except InputError:  # the motion is still known
        likelihood = None
    keypoints = options("likelihood")["keypoints"].target
    is_keypoints = isinstance(likelihood, dict) and likelihood.get("_target_") == keypoints
    weights = keypoint_weights(run.path) if is_keypoints else {}
    if not weights:
        return np.zeros(len(skeleton.names), dtype=bool), np.zeros(len(skeleton.dof_names), dtype=bool)
    return undetermined(skeleton, np.array([weights.get(name, 0.0) >= MIN_WEIGHT for name in skeleton.names]))


def true_track(run: Run) -> Track:
    """Return the true joints of a recording, without poses; InputError if there are none."""
    skeleton = _skeleton(run, "of a tracked person")
    frames, times_s, positions = timed(run.path, "true_joints")
    if len(frames) == 0:
        raise InputError(f"{run.path}: expected a recording with true joints (world/truth/joints), found none")
    return Track(skeleton, frames, times_s, positions)


def _intervals(run: Run, frames: IntArray) -> dict[str, FloatArray]:
    """Return the bounds (F,) of the parameters' 90 % intervals by name: `<name>_low` and `<name>_high`."""
    bounds = run.intervals
    if not np.array_equal(bounds.frames, frames):
        return {}
    rows = {"low": bounds.low, "high": bounds.high}
    return {f"{name}_{row}": each[:, k] for row, each in rows.items() for k, name in enumerate(bounds.names)}


def _skeleton(run: Run, kind: str) -> Skeleton:
    """Return the tracked person's skeleton, from the properties `body` and `shape`."""
    if "estimate/pose" not in run.scalars:
        raise InputError(f"{run.path}: expected a recording {kind} (estimate/pose), found none")
    return recorded_skeleton(run)
