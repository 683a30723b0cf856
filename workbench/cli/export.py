"""workbench-export: the motion in a recording as a file for Blender (.bvh), OpenSim (.trc) or a spreadsheet (.csv)."""

import argparse
import sys
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from workbench.body.kinematics import joints
from workbench.body.shape import read_shape
from workbench.body.skeleton import JOINT_NAMES, POSE_NAMES, Skeleton, person_skeleton
from workbench.motion.formats.motion_export import Track, check_output, export
from workbench.recording.read.chunks import timed
from workbench.recording.read.crash_probe import read_sound_run
from workbench.recording.read.reader import Run
from workbench.utils.arrays import FloatArray, IntArray
from workbench.utils.errors import InputError

AXES = {
    ".bvh": "y is up, z ahead where the world has x",
    ".trc": "y is up, z ahead where the world has x",
    ".csv": "z is up, as in the workbench",
}
"""Of every format, told when it is written."""


def main(argv: Sequence[str] | None = None) -> int:
    """Export one recording. Returns 0 when all is well, 2 after an error, which is printed; then nothing is written."""
    parser = argparse.ArgumentParser(prog="workbench-export", description=__doc__)
    parser.add_argument(
        "recording", metavar="RUN.rrd", type=Path, help="a run's recording, or the .part of one cut off"
    )
    parser.add_argument("output", metavar="OUT", type=Path, help="the file to write: .bvh, .trc or .csv")
    parser.add_argument("--truth", action="store_true", help="the true joints, not the estimate (.trc and .csv)")
    parser.add_argument("--metres", action="store_true", help="lengths in metres (default: BVH in cm, TRC in mm)")
    parser.add_argument("--bands", action="store_true", help="and the 5–95 %% bands of its numbers (.csv)")
    arguments = parser.parse_args(argv)
    try:
        check_output(arguments.output)  # before the work, not after it
        run = read_sound_run(arguments.recording)
        track = true_track(run) if arguments.truth else estimated_track(run)
        if arguments.bands:
            track = replace(track, bands=bands(run, track.frames))
        export(arguments.output, track, metres=arguments.metres)
    except InputError as error:
        print(error, file=sys.stderr)
        return 2
    if (left_out := len(run.poses[0]) - len(track)) > 0:
        print(f"{run.path}: {left_out} frames have no truth and are left out", file=sys.stderr)
    if run.status != "complete":
        print(f"{run.path}: the run is not complete (status: {run.status})", file=sys.stderr)
    span = f"{len(track)} frames, {track.times_s[0]:.3f} to {track.times_s[-1]:.3f} s"
    print(f"{arguments.output}: {span}; {AXES[arguments.output.suffix.lower()]}")
    return 0


def estimated_track(run: Run) -> Track:
    """Read the expected poses of a recording; raises InputError when it has none, or of another body than ours."""
    skeleton = _skeleton(run, "with poses")
    frames, times_s, poses = timed(run.path, "poses")
    if poses.shape[1:] != (len(POSE_NAMES),) or not np.isfinite(poses).all():
        raise InputError(f"{run.path}: expected poses of {len(POSE_NAMES)} finite numbers, found others")
    return Track(skeleton, frames, times_s, joints(skeleton, poses), poses)


def bands(run: Run, frames: IntArray) -> dict[str, FloatArray]:
    """Read the ends of the 5–95 % bands of a recording's numbers, in frames (F,): `<name>_low` and `<name>_high`."""
    found = {}
    for path, curve in run.scalars.items():
        *before, name, row = path.split("/")
        if before == ["posterior", "parameters"] and row in ("low", "high") and np.array_equal(curve.frames, frames):
            found[f"{name}_{row}"] = curve.values[:, 0]
    return found


def true_track(run: Run) -> Track:
    """Read the true joints of a recording, without poses; raises InputError when it has none."""
    skeleton = _skeleton(run, "of a tracked person")
    frames, times_s, positions = timed(run.path, "true_joints")
    if len(frames) == 0:
        raise InputError(f"{run.path}: expected a recording with true joints (world/truth/joints), found none")
    return Track(skeleton, frames, times_s, positions)


def _skeleton(run: Run, wanted: str) -> Skeleton:
    """The tracked person's skeleton, from the properties `body` and `shape`."""
    if "estimate/pose" not in run.scalars:
        raise InputError(f"{run.path}: expected a recording {wanted} (estimate/pose), found none")
    body = run.properties.get("body", {})
    if (tuple(body.get("joints", ())), tuple(body.get("pose", ()))) != (JOINT_NAMES, POSE_NAMES):
        raise InputError(f"{run.path}: expected the joints and pose numbers of this version's body, found others")
    return person_skeleton(read_shape(str(run.path), run.properties.get("shape", {})))
