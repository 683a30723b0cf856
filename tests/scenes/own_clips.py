"""Clips of our own skeleton, which retargeting must give back."""

import numpy as np

from workbench.body.kinematics import forward
from workbench.body.skeleton import JOINT_NAMES
from workbench.motion.clip import MotionClip
from workbench.motion.retarget import Landmarks

OWN = Landmarks(
    source="our own skeleton",
    joints={name: name for name in JOINT_NAMES if name not in ("pelvis", "head_centre")},
    head=("neck", "head_centre", 1.0),
    head_up=(0.0, 0.0, 1.0),
    lefts=dict.fromkeys(("neck", "left_shoulder", "right_shoulder", "left_hip", "right_hip"), (0.0, 1.0, 0.0)),
)


def own_clip(skeleton, poses):
    """A clip of our own skeleton in the given poses."""
    frames = forward(skeleton, poses)
    parents = np.maximum(skeleton.parents, 0)
    rotations = frames.rotations[:, parents].swapaxes(-1, -2) @ frames.rotations
    rotations[:, 0] = frames.rotations[:, 0]
    return MotionClip("own", 100.0, 1, skeleton.names, skeleton.parents, skeleton.offsets, rotations,
                      frames.positions)  # fmt: skip
