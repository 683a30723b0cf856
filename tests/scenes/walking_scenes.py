"""Motions of walkers and runners with known steps, as joints and angles for the measures of gait."""

from dataclasses import dataclass

import numpy as np

from workbench.body.kinematics import joints
from workbench.body.skeleton import JOINT_NAMES, POSE_NAMES, person_skeleton
from workbench.evaluation.gait.joint_angles import joint_angles
from workbench.evaluation.gait.stretches import rows_of_stretches, stretch_of
from workbench.evaluation.gait.walk import walk_of

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
    from workbench.motion.synthetic.gait import average_subject

    times_s = np.arange(round(seconds * rate_hz) + 1) / rate_hz
    poses = np.zeros((1, len(times_s), len(POSE_NAMES)))
    poses[..., 2] = 0.9
    return Scene(person_skeleton(average_subject().shape), times_s, poses)
