"""A synthetic motion of one arm: it swings with the elbow straight, then the elbow bends (paper A, fig. 4)."""

import hashlib

import numpy as np

from workbench.body.kinematics import joints
from workbench.body.shape import from_height
from workbench.body.skeleton import ERROR_JOINTS, JOINT_NAMES, POSE_NAMES, person_skeleton
from workbench.motion.pose_sequence import Motion

STRAIGHT_S, BEND_S, CYCLE_S = 0.7, 0.6, 1.2
HEIGHT_M, ANKLE_M = 1.75, 0.07


def bending_arm(seconds: float, rate_hz: float) -> Motion:
    """Someone stands and swings the right arm, straight for STRAIGHT_S, while the elbow then bends over BEND_S.

    With a straight elbow nothing shows how far the upper arm is twisted; once it bends, the forearm does.
    """
    times = np.arange(round(seconds * rate_hz)) / rate_hz
    skeleton = person_skeleton(from_height(HEIGHT_M))
    poses = np.zeros((len(times), len(POSE_NAMES)))
    standing = joints(skeleton, poses[:1])[0, JOINT_NAMES.index("right_ankle"), 2]
    poses[:, POSE_NAMES.index("root_z")] = ANKLE_M - standing
    swing = np.sin(2.0 * np.pi * times / CYCLE_S)
    bending = ((times - STRAIGHT_S) / BEND_S).clip(0.0, 1.0)
    bent = bending * bending * (3.0 - 2.0 * bending)  # a smooth step
    for name, angles in {
        "shoulder_flexion": 0.7 + 0.35 * swing, "shoulder_abduction": 0.25 + 0.10 * swing,
        "shoulder_twist": 0.5 + 0.2 * swing, "elbow_flexion": 1.5 * bent,
    }.items():  # fmt: skip
        poses[:, POSE_NAMES.index(f"right_{name}")] = angles
    return Motion(
        name="builtin arm", subject="builtin", activity="arm", rate_hz=rate_hz, poses=poses,
        shape=from_height(HEIGHT_M), joint_error_mm=np.zeros(len(ERROR_JOINTS)), source="builtin",
        sha256=hashlib.sha256(poses.tobytes()).hexdigest(), licence="generated, free for all uses",
    )  # fmt: skip
