"""2-D joints in OpenPose's JSON files, one file a frame, as many detectors write them."""

import json
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from tqdm import tqdm

from workbench.arrays import FloatArray, IntArray
from workbench.body.skeleton import JOINT_NAMES
from workbench.errors import InputError

Layout = Mapping[str, tuple[int, ...]]
"""Which of a detector's points make up a joint: it lies in their middle."""


_COCO_LIMBS = {
    f"{side}_{joint}": (5 + 2 * j + s,)
    for j, joint in enumerate(("shoulder", "elbow", "wrist", "hip", "knee", "ankle"))
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
}  # fmt: skip
"""Numbers of points, and what they are. Where there is a top of the head, its centre is half-way up from the neck, else
between the ears. OpenPose's own "neck" is the middle of the shoulders, which is below ours, and is left out."""
_BONES = tuple(
    (f"{side}_{a}", f"{side}_{b}")
    for side in ("left", "right")
    for a, b in (("shoulder", "elbow"), ("elbow", "wrist"), ("hip", "knee"), ("knee", "ankle"))
)
REACH = 0.5  # how far a person may be from where they were before, in heights in the image, not to be taken for another


@dataclass(frozen=True, eq=False)
class Detections:
    """One person as a detector found them. source: the folder. layout: in LAYOUTS.

    frames: (M,) numbers of the frames, rising. joints: (M, J, 3) [u px, v px, confidence 0..1] in the order of
    JOINT_NAMES, NaN for a joint that was not found.
    """

    source: str
    layout: str
    frames: IntArray
    joints: FloatArray


def read_openpose(folder: str | Path, person: int | None = None) -> Detections:
    """The person in a folder of JSON files, `people[].pose_keypoints_2d` = [u, v, confidence]…, (0, 0, 0) not found.

    A file's frame is the last number in its name. Detectors list people in any order: who is followed is the one
    numbered `person`, from 0, in the first file that shows anybody, by default the largest and surest there, and then
    whoever is nearest to where they were last seen. What the points are is told by their number, and where two layouts
    have as many, by which of them makes the limbs shorter. Raises InputError for other files and where nobody is found.
    """
    folder = Path(folder)
    files = _numbered(folder)
    people = [_people(files[frame]) for frame in tqdm(sorted(files), desc=folder.name, unit="file", disable=None)]
    if len(sizes := {found.shape[1] for found in people if len(found)}) > 1:
        raise InputError(f"{folder}: expected as many points a person in every file, found {sorted(sizes)}")
    followed = _follow(folder, people, person)
    fits = [name for name, (n, _) in LAYOUTS.items() if n == len(followed[0])]
    name = min(fits, key=lambda name: _limbs_px(LAYOUTS[name][1], followed))
    joints = np.stack([_joints(LAYOUTS[name][1], one) for one in followed])
    return Detections(str(folder), name, np.array(sorted(files)), joints)


def _numbered(folder: Path) -> dict[int, Path]:
    files: dict[int, Path] = {}
    for file in sorted(folder.glob("*.json")) if folder.is_dir() else []:
        digits = re.findall(r"\d+", file.stem)
        if not digits:
            raise InputError(f"{file}: expected the frame's number in the file's name, found none")
        if int(digits[-1]) in files:
            raise InputError(f"{file}: frame {int(digits[-1])} is already in {files[int(digits[-1])].name}")
        files[int(digits[-1])] = file
    if not files:
        raise InputError(f"{folder}: expected a folder of OpenPose's JSON files, found none")
    return files


def _people(file: Path) -> FloatArray:
    """Points (n, K, 3) of the people in one file; NaN where a point was not found."""
    try:
        content = json.loads(file.read_text(encoding="utf-8"))
        found = [_points(one) for one in content["people"]]
    except (OSError, UnicodeDecodeError, ValueError, KeyError, TypeError) as error:
        raise InputError(f"{file}: expected OpenPose's people with pose_keypoints_2d, found {error!r}") from None
    sizes = {len(points) for points in found}
    if len(sizes) > 1 or not sizes <= {n for n, _ in LAYOUTS.values()}:
        known = ", ".join(f"{n} ({name})" for name, (n, _) in LAYOUTS.items())
        raise InputError(f"{file}: expected one of {known} points a person, found {sorted(sizes)}")
    return np.stack(found) if found else np.empty((0, 0, 3))


def _points(person: Mapping[str, Any]) -> FloatArray:
    points = np.array(person["pose_keypoints_2d"], dtype=np.float64).reshape(-1, 3)
    if not np.isfinite(points).all():
        raise ValueError("numbers that are not finite")
    points[points[:, 2] <= 0.0] = np.nan
    points[:, 2] = np.minimum(points[:, 2], 1.0)
    return points


def _follow(folder: Path, people: Sequence[FloatArray], person: int | None) -> list[FloatArray]:
    """One person's points (K, 3) in every frame, NaN where they are not seen."""
    first = next((found for found in people if np.isfinite(found).any()), None)
    if first is None:
        raise InputError(f"{folder}: expected a person in some frame, found nobody in {len(people)}")
    if person is not None and not 0 <= person < len(first):
        some = f"0 to {len(first) - 1}"
        raise InputError(f"{folder}: no person {person} where the first are found, expected one of {some}")
    seen = [np.isfinite(one[:, 2]).any() for one in first]
    sure = [np.nansum(one[:, 2]) * _height(one) if some else -1.0 for one, some in zip(first, seen, strict=True)]
    last = first[int(np.argmax(sure)) if person is None else person]
    followed = []
    for found in people:
        apart = [_distance(last, one) for one in found]
        near = int(np.argmin(apart)) if apart else -1
        there = near >= 0 and apart[near] < REACH * _height(last)
        followed.append(found[near] if there else np.full_like(last, np.nan))
        last = found[near] if there else last
    return followed


def _height(points: FloatArray) -> float:
    """Measure what is seen in the image, px: the longer side of its bounding box."""
    return float(np.max(np.nanmax(points[:, :2], axis=0) - np.nanmin(points[:, :2], axis=0)))


def _distance(points: FloatArray, others: FloatArray) -> float:
    """Median distance of what is seen in both, px; infinite where nothing is."""
    apart = np.linalg.norm(points[:, :2] - others[:, :2], axis=1)
    return float(np.nanmedian(apart)) if np.isfinite(apart).any() else np.inf


def _limbs_px(layout: Layout, points: Sequence[FloatArray]) -> float:
    """The mean over the limbs of their median lengths in the image, px; infinite where none is seen."""
    joints = dict(zip(JOINT_NAMES, np.stack([_joints(layout, one) for one in points], axis=1), strict=True))
    lengths = [np.linalg.norm((joints[a] - joints[b])[:, :2], axis=1) for a, b in _BONES]
    medians = [np.median(some[np.isfinite(some)]) for some in lengths if np.isfinite(some).any()]
    return float(np.mean(medians)) if medians else np.inf


def _joints(layout: Layout, points: FloatArray) -> FloatArray:
    """Joints (J, 3) of points (K, 3): the middle of those that make them up, as sure as the least sure."""
    joints = np.full((len(JOINT_NAMES), 3), np.nan)
    for name, numbers in layout.items():
        made_of = points[list(numbers)]
        joints[JOINT_NAMES.index(name)] = [*made_of[:, :2].mean(axis=0), made_of[:, 2].min()]
    return joints
