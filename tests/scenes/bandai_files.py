"""Motion files of generated people with the joints and frames of Bandai's files."""

from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

from workbench.body.kinematics import forward
from workbench.body.skeleton import person_skeleton
from workbench.motion.pose_sequence import Motion

_FILE_FROM_WORLD = [1, 2, 0]  # files are y-up with the person facing z
_AHEAD, _LEFT, _UP = np.eye(3)
# Parent, offset in its frame (cm), the person's joint that it rotates with, and its x and y axes in the neutral pose.
JOINTS = {
    "joint_Root": (None, (0, 0, 0), None, _AHEAD, _LEFT),
    "Hips": ("joint_Root", (0, 0, 0), "pelvis", _AHEAD, _UP),
    "Spine": ("Hips", (0, 14, 0), "pelvis", _LEFT, _UP),
    "Chest": ("Spine", (0, 12, 0), "pelvis", _LEFT, _UP),
    "Neck": ("Chest", (0, 20, 0), "pelvis", _LEFT, _UP),
    "Head": ("Neck", (0, 7, 0), "neck", _LEFT, _UP),
}
for _side, _left, _sign in (("L", "left", 1), ("R", "right", -1)):
    _x, _y = _sign * _AHEAD, -_sign * _UP  # bones lie along y, on the right backwards
    JOINTS |= {
        f"Shoulder_{_side}": ("Chest", (5 * _sign, 15, 0), "pelvis", _sign * _AHEAD, _LEFT),
        f"UpperArm_{_side}": (f"Shoulder_{_side}", (0, 12 * _sign, 0), f"{_left}_shoulder", _x, _y),
        f"LowerArm_{_side}": (f"UpperArm_{_side}", (0, 27 * _sign, 0), f"{_left}_elbow", _x, _y),
        f"Hand_{_side}": (f"LowerArm_{_side}", (0, 24 * _sign, 0), f"{_left}_elbow", _x, _y),
        f"UpperLeg_{_side}": ("Hips", (0, -2, -8 * _sign), f"{_left}_hip", _x, _y),
        f"LowerLeg_{_side}": (f"UpperLeg_{_side}", (0, 42 * _sign, 0), f"{_left}_knee", _x, _y),
        f"Foot_{_side}": (f"LowerLeg_{_side}", (0, 42 * _sign, 0), f"{_left}_knee", _sign * _UP, _sign * _AHEAD),
        f"Toes_{_side}": (f"Foot_{_side}", (0, 13 * _sign, 0), f"{_left}_knee", _sign * _UP, _sign * _AHEAD),
    }


def write_bandai_like(path: Path, motion: Motion) -> None:
    """Write a person's motion as a BVH file on the skeleton above, in cm, with rotation channels Z X Y."""
    skeleton, names = person_skeleton(motion.shape), list(JOINTS)
    rotations = forward(skeleton, motion.poses).rotations
    world = np.tile(np.eye(3), (len(names), len(motion), 1, 1))
    for k, (_, _, joint, x, y) in enumerate(JOINTS.values()):
        neutral = np.stack([x, y, np.cross(x, y)], axis=1)
        world[k] = neutral if joint is None else rotations[:, skeleton.joint(joint)] @ neutral
    columns, hierarchy = [], _branch("joint_Root")
    for name in (line.split()[1] for line in hierarchy if line.startswith(("ROOT", "JOINT"))):
        k, parent = names.index(name), JOINTS[name][0]
        local = world[k] if parent is None else world[names.index(parent)].swapaxes(1, 2) @ world[k]
        local = local[:, _FILE_FROM_WORLD][:, :, _FILE_FROM_WORLD]
        if name == "Hips":  # its parent's frame is the world's
            columns.append(100.0 * motion.poses[:, :3][:, _FILE_FROM_WORLD])
        # gimbal lock is harmless here
        angles = Rotation.from_matrix(local).as_euler("ZXY", degrees=True, suppress_warnings=True)
        columns.append(angles)
    head = ["MOTION", f"Frames: {len(motion)}", f"Frame Time: {1.0 / motion.rate_hz:.9f}"]
    rows = [" ".join(f"{value:.6f}" for value in row) for row in np.hstack(columns)]
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text("\n".join(["HIERARCHY", *hierarchy, *head, *rows, ""]))


def _branch(name: str) -> list[str]:
    x, y, z = (JOINTS[name][1][axis] for axis in _FILE_FROM_WORLD)
    channels = "6 Xposition Yposition Zposition" if name == "Hips" else "3"
    children = [child for child, (parent, *_) in JOINTS.items() if parent == name]
    return [
        f"{'JOINT' if JOINTS[name][0] else 'ROOT'} {name}", "{", f"OFFSET {x} {y} {z}",
        f"CHANNELS {channels} Zrotation Xrotation Yrotation",
        *(line for child in children for line in _branch(child)),
        *([] if children else ["End Site", "{", "OFFSET 0 0 0", "}"]), "}",
    ]  # fmt: skip
