"""Motions of walkers and runners with known steps, as joints and angles for the measures of gait."""

from dataclasses import dataclass

import numpy as np

from workbench.body.kinematics import joints
from workbench.body.limbs import person
from workbench.body.shape import from_height
from workbench.body.skeleton import JOINT_NAMES, POSE_NAMES, person_skeleton
from workbench.core.frame import Frame
from workbench.core.state_space import StateSpace
from workbench.core.step import Step
from workbench.evaluation.gait.joint_angles import joint_angles
from workbench.evaluation.gait.stretches import rows_of_stretches, stretch_of
from workbench.evaluation.gait.walk import walk_of
from workbench.evaluation.verdict.joint_states import JOINT_GROUPS
from workbench.evaluation.verdict.run_measurements import MeasurementCollector
from workbench.evaluation.verdict.run_verdict import Verdict
from workbench.motion.synthetic.gait import average_subject
from workbench.recording.write.recorder import Recorder
from workbench.utils.finding import Finding

HEIGHT_M = 1.75


@dataclass
class Scene:
    """Poses (M, F, 25) of M motions at times (F,), s."""

    skeleton: object
    times_s: np.ndarray
    poses: np.ndarray

    @property
    def joints(self):
        rows = joints(self.skeleton, self.poses.reshape(-1, len(POSE_NAMES)))
        return rows.reshape(*self.poses.shape[:2], len(JOINT_NAMES), 3)

    def stretch(self):
        rows = np.arange(len(self.times_s))
        return stretch_of(JOINT_NAMES, self.joints, np.zeros((*self.poses.shape[:2], 1)), self.times_s, rows)

    def walk(self, valid=None):
        valid = np.ones(len(self.times_s), bool) if valid is None else valid
        angles = joint_angles(POSE_NAMES, self.poses)
        rotation = angles.names.index("torso_rotation")
        stretches = rows_of_stretches(self.times_s, valid)
        return walk_of(JOINT_NAMES, self.joints, angles.values, rotation, self.times_s, stretches, HEIGHT_M)

    def frames(self, rows):
        return Scene(self.skeleton, self.times_s[rows], self.poses[:, rows])


def scene(motion):
    """Return a motion as a scene of one motion."""
    times_s = np.arange(len(motion)) / motion.rate_hz
    return Scene(person_skeleton(motion.shape), times_s, motion.poses[None].copy())


def on_treadmill(scene, speed_m_s):
    """Return a walk along x on a belt of this speed."""
    poses = scene.poses.copy()
    poses[:, :, 0] -= speed_m_s * scene.times_s
    return Scene(scene.skeleton, scene.times_s, poses)


def standing(seconds, rate_hz=30.0):
    """Return a person who stands still."""
    times_s = np.arange(round(seconds * rate_hz) + 1) / rate_hz
    poses = np.zeros((1, len(times_s), len(POSE_NAMES)))
    poses[..., 2] = 0.9
    return Scene(person_skeleton(average_subject().shape), times_s, poses)


def record(path, scene, lost=(), states=None, config_yaml="", body=None, frames=None):
    """Record a scene, whose motions after the first are samples, and return the path.

    lost: frames in which the person is lost. states: of parts of the body, by part; without either, no states.
    """
    space = StateSpace.of({"phase": (("phase",), "cycle")})
    body = person(from_height(HEIGHT_M)) if body is None else body
    frames = np.arange(len(scene.times_s)) if frames is None else frames
    collector = MeasurementCollector(body)
    with Recorder(path, body, space, run_id=path.name, config_yaml=config_yaml, provenance={}) as recorder:
        for k, frame in enumerate(frames):
            step = _step(space, int(frame), float(scene.times_s[k]), scene.poses[:, k])
            recorder.log(step, {})
            collector.add(step, {})
        if lost or states:
            n = len(scene.times_s)
            words = tuple("lost" if k in set(lost) else "tracked" for k in range(n))
            parts = dict.fromkeys(JOINT_GROUPS, ["tracked"] * n) | (states or {})
            verdict = Verdict((), Finding("tracked", "tracked", "trustworthy"), words, parts)
            recorder.set_verdict(verdict, collector.measurements())
    return path


def _step(space, frame, time_s, poses):
    draws = poses[1:] if len(poses) > 1 else None
    return Step(
        frame=Frame(frame, time_s, (), None), space=space, particles=np.zeros((1, 1)), poses=poses[:1],
        log_weights=np.zeros(1), ancestors=np.zeros(1, int), expected_pose=poses[0], map_pose=poses[0], ess=1.0,
        log_evidence=0.0, diagnostics={}, draws=draws,
    )  # fmt: skip
