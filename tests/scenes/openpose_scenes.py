"""Folders of OpenPose's files, made up: a person of any layout, in any order among others."""

import json

import numpy as np

from workbench.motion.formats.keypoint_layouts import LAYOUTS


def points(layout, joints, confidence=0.8):
    """Points (K, 3) of a layout for joints by name, (u, v); a joint's points all lie in it, others are not found."""
    n, made_of = LAYOUTS[layout]
    found = np.zeros((n, 3))
    for name, place in joints.items():
        for number in made_of.get(name, ()):
            found[number] = [*place, confidence]
    if "neck" in made_of and "neck" in joints:  # the head's centre is half-way to its top
        (neck,) = made_of["neck"]
        (top,) = set(made_of["head_centre"]) - {neck}
        found[neck, :2], found[top, :2] = joints["neck"], 2.0 * np.array(joints["head_centre"]) - joints["neck"]
    return found


def standing(u, v, size=100.0):
    """Joints of someone upright whose head is at (u, v), seen from ahead."""
    across = {"shoulder": 0.12, "elbow": 0.14, "wrist": 0.15, "hip": 0.06, "knee": 0.06, "ankle": 0.06}
    down = {"shoulder": 0.12, "elbow": 0.3, "wrist": 0.45, "hip": 0.45, "knee": 0.7, "ankle": 0.95}
    joints = {"head_centre": (u, v), "neck": (u, v + 0.08 * size)}
    for side, sign in (("left", 1.0), ("right", -1.0)):
        joints |= {f"{side}_{name}": (u + sign * across[name] * size, v + down[name] * size) for name in across}
    return joints


def write(folder, frames, name="shot_{:012d}_keypoints.json"):
    """One file for every frame of {number: [points (K, 3), …]}."""
    folder.mkdir(parents=True, exist_ok=True)
    for number, people in frames.items():
        found = [{"person_id": [-1], "pose_keypoints_2d": one.ravel().tolist()} for one in people]
        (folder / name.format(number)).write_text(json.dumps({"version": 1.3, "people": found}))
    return folder
