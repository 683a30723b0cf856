"""Synthetic motion of one arm: it swings with a straight elbow, which then bends (paper A, fig. 4)."""

import hashlib

import numpy as np

from workbench.body.kinematics import joints
from workbench.body.shape import from_height
from workbench.body.skeleton import ERROR_JOINTS, JOINT_NAMES, POSE_NAMES, person_skeleton
from workbench.motion.pose_sequence import Motion

STRAIGHT_S, BEND_S, CYCLE_S = 0.7, 0.6, 1.2
BEND_RAD = 0.5
"""The arm of the figure "bends slightly" around frame 20."""
HEIGHT_M, ANKLE_M = 1.75, 0.07


def bending_arm(seconds: float, rate_hz: float) -> Motion:
    """Return the motion of a standing person who swings the right arm, straight for STRAIGHT_S, then bends it over
    BEND_S.

    With a straight elbow the twist of the upper arm is not observable; once it bends, the forearm determines the twist.
    """
    times = np.arange(round(seconds * rate_hz)) / rate_hz
    skeleton = person_skeleton(from_height(HEIGHT_M))
    poses = np.zeros((len(times), len(POSE_NAMES)))
    ankle_height = joints(skeleton, poses[:1])[0, JOINT_NAMES.index("right_ankle"), 2]
    poses[:, POSE_NAMES.index("root_z")] = ANKLE_M - ankle_height
    swing = np.sin(2.0 * np.pi * times / CYCLE_S)
    bend_fraction = ((times - STRAIGHT_S) / BEND_S).clip(0.0, 1.0)
    smooth_step = bend_fraction * bend_fraction * (3.0 - 2.0 * bend_fraction)
    for name, angles in {
        "shoulder_flexion": 0.7 + 0.35 * swing, "shoulder_abduction": 0.25 + 0.10 * swing,
        "shoulder_twist": 0.5 + 0.2 * swing, "elbow_flexion": BEND_RAD * smooth_step,
    }.items():  # fmt: skip
        poses[:, POSE_NAMES.index(f"right_{name}")] = angles
    return Motion(
        name="builtin arm", subject="builtin", activity="arm", rate_hz=rate_hz, poses=poses,
        shape=from_height(HEIGHT_M), joint_error_mm=np.zeros(len(ERROR_JOINTS)), source="builtin",
        sha256=hashlib.sha256(poses.tobytes()).hexdigest(), licence="generated, free for all uses",
    )  # fmt: skip
