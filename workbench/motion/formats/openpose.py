"""2-D keypoints in OpenPose's JSON files, one file per frame, a format of many detectors."""

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from tqdm import tqdm

from workbench.body.skeleton import JOINT_NAMES
from workbench.utils.arrays import FloatArray, IntArray
from workbench.utils.errors import InputError
from workbench.utils.input_limits import LARGEST_PX, check_file, parse_json

Layout = Mapping[str, tuple[int, ...]]
"""The detector's points by joint; a joint is at their mean."""

_COCO_LIMBS = {
    f"{side}_{joint}": (5 + 2 * j + s,)
    for j, joint in enumerate(("shoulder", "elbow", "wrist", "hip", "knee", "ankle"))
    for s, side in enumerate(("left", "right"))
}
_BLAZEPOSE_LIMBS = {
    f"{side}_{joint}": (first + s,)
    for joint, first in (("shoulder", 11), ("elbow", 13), ("wrist", 15), ("hip", 23), ("knee", 25), ("ankle", 27))
    for s, side in enumerate(("left", "right"))
}
_BODY_ARMS = {
    "right_shoulder": (2,), "right_elbow": (3,), "right_wrist": (4,),
    "left_shoulder": (5,), "left_elbow": (6,), "left_wrist": (7,),
}  # fmt: skip
LAYOUTS: Mapping[str, tuple[int, Layout]] = {
    "BODY_25": (25, _BODY_ARMS | {
        "pelvis": (8,), "right_hip": (9,), "right_knee": (10,), "right_ankle": (11,),
        "left_hip": (12,), "left_knee": (13,), "left_ankle": (14,), "head_centre": (17, 18),
    }),
    "BODY_25B": (25, _COCO_LIMBS | {"neck": (17,), "head_centre": (17, 18)}),
    "HALPE_26": (26, _COCO_LIMBS | {"neck": (18,), "head_centre": (17, 18), "pelvis": (19,)}),
    "COCO_18": (18, _BODY_ARMS | {
        "right_hip": (8,), "right_knee": (9,), "right_ankle": (10,),
        "left_hip": (11,), "left_knee": (12,), "left_ankle": (13,), "head_centre": (16, 17),
    }),
    "COCO_17": (17, _COCO_LIMBS | {"head_centre": (3, 4)}),
    "BLAZEPOSE_33": (33, _BLAZEPOSE_LIMBS | {"head_centre": (7, 8)}),
}  # fmt: skip
"""Numbers of points, and points by joint. The centre of the head is half-way between neck and top of the head, if there
is one, else between the ears. OpenPose's own "neck", the middle of the shoulders, is below ours and is excluded."""
_BONES = tuple(
    (f"{side}_{a}", f"{side}_{b}")
    for side in ("left", "right")
    for a, b in (("shoulder", "elbow"), ("elbow", "wrist"), ("hip", "knee"), ("knee", "ankle"))
)


@dataclass(frozen=True, eq=False)
class People:
    """Detected people. source : the folder. layout : in LAYOUTS. frames : (M,) numbers of the frames, ascending.

    joints : (n, J, 3) per frame, for n people in the order of the file, [u px, v px, confidence 0..1] in the order of
    JOINT_NAMES; NaN for a joint that was not detected and for all joints of an empty person. (n, J, 6) where the files
    have world landmarks, [x, y, z] m about the middle of the hips along the camera's axes.
    """

    source: str
    layout: str
    frames: IntArray
    joints: tuple[FloatArray, ...]


def read_openpose(folder: str | Path) -> People:
    """Return the people in a folder of JSON files with `people[].pose_keypoints_2d` = [u, v, confidence]….

    A point without detection is (0, 0, 0), a person without detection []. A file's frame is the last number in its
    name. The layout follows from the number of points; of two layouts with the same number, it is the one with shorter
    limbs. The order of people in a file is arbitrary, see `datasets.association`. Raises InputError for files of
    another format, or no person is detected.
    """
    folder = Path(folder)
    files = _numbered(folder)
    people = [_people(files[frame]) for frame in tqdm(sorted(files), desc=folder.name, unit="file", disable=None)]
    if len(sizes := {len(person) for frame in people for person in frame} - {0}) > 1:
        raise InputError(
            f"{folder}: expected the same number of points per person in every file, found {sorted(sizes)}"
        )
    detected = [person for frame in people for person in frame if np.isfinite(person).any()]
    if not detected:
        raise InputError(f"{folder}: expected a person in some frame, found none in {len(people)} frames")
    candidates = [name for name, (n, _) in LAYOUTS.items() if n == len(detected[0])]
    name = min(candidates, key=lambda name: _limbs_px(LAYOUTS[name][1], detected))
    width = min(person.shape[1] for person in detected)
    joints = [[_joints(LAYOUTS[name][1], person, width) for person in frame] for frame in people]
    by_frame = tuple(np.array(frame).reshape(-1, len(JOINT_NAMES), width) for frame in joints)
    return People(str(folder), name, np.array(sorted(files)), by_frame)


def _numbered(folder: Path) -> dict[int, Path]:
    files: dict[int, Path] = {}
    for file in sorted(folder.glob("*.json")) if folder.is_dir() else []:
        digits = re.findall(r"\d+", file.stem)
        if not digits or int(digits[-1]) >= 10**9:
            raise InputError(f"{file}: expected the frame's number in the file's name, found {digits[-1:] or 'none'}")
        if int(digits[-1]) in files:
            raise InputError(f"{file}: frame {int(digits[-1])} is already in {files[int(digits[-1])].name}")
        files[int(digits[-1])] = file
    if not files:
        raise InputError(f"{folder}: expected a folder of OpenPose's JSON files, found none")
    return files


def _people(file: Path) -> list[FloatArray]:
    """Return points (K, 3) of the people in one file, (K, 6) with world landmarks, NaN without detection; K is 0 for an
    empty person."""
    try:
        check_file(file)
        people = [_points(person) for person in parse_json(file, file.read_bytes())["people"]]
    except InputError:
        raise
    except (OSError, ValueError, KeyError, TypeError, OverflowError) as error:
        raise InputError(f"{file}: expected OpenPose's people with pose_keypoints_2d, found {error!r}") from None
    sizes = {len(points) for points in people} - {0}
    if len(sizes) > 1 or not sizes <= {n for n, _ in LAYOUTS.values()}:
        options = ", ".join(f"{n} ({name})" for name, (n, _) in LAYOUTS.items())
        raise InputError(f"{file}: expected one of {options} points per person, found {sorted(sizes)}")
    return people


def _points(person: Mapping[str, Any]) -> FloatArray:
    points = np.array(person["pose_keypoints_2d"], dtype=np.float64).reshape(-1, 3)
    if not np.isfinite(points).all():
        raise ValueError("numbers that are not finite")
    if len(points) and np.abs(points[:, :2]).max() > LARGEST_PX:
        raise ValueError(f"a coordinate beyond {LARGEST_PX:g} px")
    if len(person.get("world_landmarks", ())):
        world = np.array(person["world_landmarks"], dtype=np.float64).reshape(-1, 3)
        if len(world) != len(points) or not np.isfinite(world).all():
            raise ValueError(f"world_landmarks of {len(world)} points, or not finite")
        points = np.hstack([points, world])
    points[points[:, 2] <= 0.0] = np.nan
    points[:, 2] = np.minimum(points[:, 2], 1.0)
    return points


def _limbs_px(layout: Layout, points: Sequence[FloatArray]) -> float:
    """Return the mean over the limbs of their median lengths in the image, px; infinite if none is detected."""
    joints = dict(zip(JOINT_NAMES, np.stack([_joints(layout, person) for person in points], axis=1), strict=True))
    lengths = [np.linalg.norm((joints[a] - joints[b])[:, :2], axis=1) for a, b in _BONES]
    medians = [np.median(length[np.isfinite(length)]) for length in lengths if np.isfinite(length).any()]
    return float(np.mean(medians)) if medians else np.inf


def _joints(layout: Layout, points: FloatArray, width: int = 3) -> FloatArray:
    """Return joints (J, width) at the mean of their points of (K, ≥ width), with the smallest of their confidences."""
    joints = np.full((len(JOINT_NAMES), width), np.nan)
    for name, numbers in layout.items() if len(points) else ():
        selected = points[list(numbers), :width]
        joints[JOINT_NAMES.index(name)] = selected.mean(axis=0)
        joints[JOINT_NAMES.index(name), 2] = selected[:, 2].min()
    return joints
