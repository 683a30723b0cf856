"""The tracked person of a recording: the skeleton, and the estimated poses."""

import numpy as np

from workbench.body.shape import read_shape
from workbench.body.skeleton import (
    JOINT_NAMES,
    JOINT_NAMES_WITH_FEET,
    POSE_NAMES,
    POSE_NAMES_WITH_FEET,
    Skeleton,
    feet_skeleton,
    person_skeleton,
)
from workbench.recording.read.chunks import timed
from workbench.recording.read.reader import Run
from workbench.utils.arrays import FloatArray, IntArray
from workbench.utils.errors import InputError

_BODIES = {(JOINT_NAMES, POSE_NAMES): person_skeleton, (JOINT_NAMES_WITH_FEET, POSE_NAMES_WITH_FEET): feet_skeleton}


def recorded_skeleton(run: Run) -> Skeleton:
    """Return the person's skeleton by the properties `body` and `shape`; raises InputError for another body."""
    body = run.properties.get("body", {})
    make = _BODIES.get((tuple(body.get("joints", ())), tuple(body.get("pose", ()))))
    if make is None:
        raise InputError(f"{run.path}: expected the joints and pose parameters of this version's body, found others")
    return make(read_shape(str(run.path), run.properties.get("shape", {})))


def recorded_poses(run: Run, skeleton: Skeleton) -> tuple[IntArray, FloatArray, FloatArray]:
    """Return the frames (F,), times (F,), s, and estimated poses (F, P) of a skeleton; raises InputError for others."""
    frames, times_s, poses = timed(run.path, "poses")
    if not len(frames):
        raise InputError(f"{run.path}: expected the poses of a person (estimate/pose), found none")
    n = len(skeleton.dof_names)
    if poses.shape[1:] != (n,) or not np.isfinite(poses).all():
        raise InputError(f"{run.path}: expected poses of {n} finite numbers, found other values")
    return frames, times_s, poses
