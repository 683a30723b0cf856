"""Synthetic folders of OpenPose files: people of any layout in any order."""

import json

import numpy as np

from workbench.detections.readers.formats import LAYOUTS
from workbench.detections.readers.named_points import layout_joints
from workbench.detections.readers.people import SourceImages, read_people


def points(layout, joints, confidence=0.8):
    """Return points (K, 3) of a layout at joints (u, v) by name; a joint's points coincide, the others are zero."""
    numbers = layout_joints(LAYOUTS[layout])
    rows = np.zeros((len(LAYOUTS[layout]), 3))
    for name, place in joints.items():
        for number in numbers.get(name, ()):
            rows[number] = [*place, confidence]
    if "neck" in numbers and "neck" in joints:  # the head's centre is half-way to its top
        (neck,) = numbers["neck"]
        (top,) = set(numbers["head_centre"]) - {neck}
        rows[neck, :2], rows[top, :2] = joints["neck"], 2.0 * np.array(joints["head_centre"]) - joints["neck"]
    return rows


def standing(u, v, size=100.0):
    """Return joints of a person who faces the camera, with the head at (u, v)."""
    across = {"shoulder": 0.12, "elbow": 0.14, "wrist": 0.15, "hip": 0.06, "knee": 0.06, "ankle": 0.06}
    down = {"shoulder": 0.12, "elbow": 0.3, "wrist": 0.45, "hip": 0.45, "knee": 0.7, "ankle": 0.95}
    joints = {"head_centre": (u, v), "neck": (u, v + 0.08 * size)}
    for side, sign in (("left", 1.0), ("right", -1.0)):
        joints |= {f"{side}_{name}": (u + sign * across[name] * size, v + down[name] * size) for name in across}
    return joints


def write(folder, frames, name="shot_{:012d}_keypoints.json"):
    """Write one file for every frame of {number: [points (K, 3), …]}."""
    folder.mkdir(parents=True, exist_ok=True)
    for number, people in frames.items():
        rows = [{"person_id": [-1], "pose_keypoints_2d": points.ravel().tolist()} for points in people]
        (folder / name.format(number)).write_text(json.dumps({"version": 1.3, "people": rows}))
    return folder


def people_in(path):
    """Return the people detected in a folder or file, in images of unknown size."""
    return read_people({"": path}, {"": SourceImages()})[""]
