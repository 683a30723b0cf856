"""Small clips for the tests of the full skeleton."""

import numpy as np
from scipy.spatial.transform import Rotation

from workbench.motion.clip import MotionClip, joint_positions, world_rotations

# Bandai's joints with invented lengths, m; every bone lies along its parent's y, backwards on the right.
BANDAI_LIKE = {
    "joint_Root": (None, (0, 0, 0)), "Hips": ("joint_Root", (0, 0, 0.9)),
    "Spine": ("Hips", (0, 0.15, 0)), "Chest": ("Spine", (0, 0.1, 0)), "Neck": ("Chest", (0, 0.2, 0)),
    "Head": ("Neck", (0, 0.07, 0)), "Head_end": ("Head", (0, 0, 0)),
    "Shoulder_L": ("Chest", (0.05, 0.15, 0)), "UpperArm_L": ("Shoulder_L", (0, 0.06, 0)),
    "LowerArm_L": ("UpperArm_L", (0, 0.25, 0)), "Hand_L": ("LowerArm_L", (0, 0.23, 0)),
    "Hand_L_end": ("Hand_L", (0, 0, 0)),
    "Shoulder_R": ("Chest", (-0.05, 0.15, 0)), "UpperArm_R": ("Shoulder_R", (0, -0.06, 0)),
    "LowerArm_R": ("UpperArm_R", (0, -0.25, 0)), "Hand_R": ("LowerArm_R", (0, -0.23, 0)),
    "UpperLeg_L": ("Hips", (0, -0.02, -0.07)), "LowerLeg_L": ("UpperLeg_L", (0, 0.4, 0)),
    "Foot_L": ("LowerLeg_L", (0, 0.41, 0)), "Toes_L": ("Foot_L", (0, 0.12, 0)),
    "UpperLeg_R": ("Hips", (0, -0.02, 0.07)), "LowerLeg_R": ("UpperLeg_R", (0, -0.4, 0)),
    "Foot_R": ("LowerLeg_R", (0, -0.41, 0)), "Toes_R": ("Foot_R", (0, -0.12, 0)),
}  # fmt: skip
TRAVELLER = {
    "root": (None, (0, 0, 0)), "arm": ("root", (0, 0.3, 0)), "hand": ("arm", (0, 0.2, 0)),
    "hand_end": ("hand", (0, 0.1, 0)), "tail": ("root", (-0.2, 0, 0)), "tail_end": ("tail", (0, 0, 0)),
}  # fmt: skip


def clip(joints, rotations, places=None, name="made"):
    """Return a clip of joints {name: (parent, offset)}, rotations (F, K, 3, 3) and offsets over time (F, K, 3)."""
    names = tuple(joints)
    parents = np.array([-1 if parent is None else names.index(parent) for parent, _ in joints.values()])
    offsets = np.array([offset for _, offset in joints.values()], dtype=np.float64)
    if places is None:
        places = np.broadcast_to(offsets, (len(rotations), *offsets.shape))
    positions = joint_positions(parents, world_rotations(parents, rotations), places)
    return MotionClip(name, 30.0, names, parents, offsets, rotations, positions)


def wandering(joints, seed, n=60, size=0.02, still=()):
    """Return random-walk rotations (F, K, 3, 3) of about `size` rad per frame; joints in `still` do not rotate."""
    rng = np.random.default_rng(seed)
    rotation = Rotation.random(len(joints), random_state=seed)
    frames = []
    for _ in range(n):
        rotation = rotation * Rotation.from_rotvec(size * rng.standard_normal((len(joints), 3)))
        frames.append(rotation.as_matrix())
    rotations = np.array(frames)
    rotations[:, [list(joints).index(name) for name in still]] = np.eye(3)
    return rotations
