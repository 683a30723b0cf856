"""The motion of a recording, with the samples of its posterior and the frames in which the person is tracked."""

from dataclasses import dataclass

import numpy as np

from workbench.body.kinematics import joints
from workbench.body.skeleton import Skeleton
from workbench.evaluation.verdict.joint_states import JOINT_GROUPS, LOST, NOT_SEEN
from workbench.recording.read.person import recorded_poses, recorded_skeleton
from workbench.recording.read.reader import Run
from workbench.recording.read.states import lane
from workbench.utils.arrays import BoolArray, FloatArray, IntArray
from workbench.utils.errors import InputError


@dataclass(frozen=True, eq=False)
class RecordedMotion:
    """M motions in F frames: the expected one, followed by the samples of the posterior, if there are any.

    frames: (F,), their numbers. times_s: (F,), s, increasing. poses: (M, F, P). tracked: (F,), whether the person is
    not lost. seen: by part of the body (F,), whether some camera sees it and it is not lost.
    """

    skeleton: Skeleton
    frames: IntArray
    times_s: FloatArray
    poses: FloatArray
    tracked: BoolArray
    seen: dict[str, BoolArray]

    @property
    def joints(self) -> FloatArray:
        """Positions (M, F, J, 3), m, in the world."""
        return np.stack([joints(self.skeleton, poses) for poses in self.poses])


def recorded_motion(run: Run) -> RecordedMotion:
    """Return the motion of a recording; raises InputError if there is none, or for another body."""
    if run.is_study:
        raise InputError(f"{run.path}: expected a run that tracks a person, found a study")
    skeleton = recorded_skeleton(run)
    frames, times_s, poses = recorded_poses(run, skeleton)
    if not (np.diff(times_s) > 0.0).all():
        raise InputError(f"{run.path}: expected times that increase from frame to frame, found others")
    samples = run.draws
    motions = poses[None] if samples is None else np.concatenate([poses[None], samples])
    states = {name: np.array(lane(run.path, name, frames.tolist())) for name in ("tracking", *JOINT_GROUPS)}
    seen = {name: ~np.isin(states[name], (LOST, NOT_SEEN)) for name in JOINT_GROUPS}
    return RecordedMotion(skeleton, frames, times_s, motions, states["tracking"] != LOST, seen)
