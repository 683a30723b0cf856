"""Consistency of calibrated cameras without a tracker: distances of rays, lengths of limbs, directions of knees."""

from collections.abc import Sequence
from itertools import combinations

import numpy as np

from workbench.body.camera import Camera, nearest_points
from workbench.body.skeleton import JOINT_NAMES
from workbench.core.frame import View
from workbench.utils.arrays import FloatArray

LIMBS = {
    "upper_arm": ("shoulder", "elbow"), "forearm": ("elbow", "wrist"),
    "thigh": ("hip", "knee"), "calf": ("knee", "ankle"),
}  # fmt: skip
"""Limbs of either side, between these joints."""
_SIDES = ("left", "right")
_BENT = 0.05
"""How far a knee is off the line from hip to ankle, over its length, when the leg counts as bent: some 12 degrees."""


def meeting(views: Sequence[View]) -> tuple[dict[tuple[str, str], float], FloatArray]:
    """Let the rays of the views' keypoints meet, those of weight 0 left out.

    Return by pair of cameras the median over the joints of how far both are off the place nearest to their rays, in
    heights of the person in the image; and the joints (J, 3), m, by all cameras, NaN where fewer than two see one.
    """
    seen = {view.camera.name: (view.camera, found_marks(view)) for view in views if view.keypoints is not None}
    apart = {}
    for (first, a), (second, b) in combinations(seen.items(), 2):
        places, heights = nearest([a, b]), (height_px(a[1]), height_px(b[1]))
        if np.isfinite(places[:, 0]).any() and min(heights) > 0.0:
            off = [
                np.linalg.norm(camera.project(places) - marks, axis=1) / height
                for (camera, marks), height in zip((a, b), heights, strict=True)
            ]
            known = np.isfinite(places[:, 0])
            # behind a camera is as far as it gets: one height of the person
            apart[first, second] = float(np.median(np.nan_to_num(np.mean(off, axis=0)[known], nan=1.0)))
    return apart, nearest(list(seen.values()))


def nearest(seen: Sequence[tuple[Camera, FloatArray]]) -> FloatArray:
    """Return the places (J, 3), m, nearest in the mean square to the cameras' rays to marks (J, 2), px, NaN for none;
    NaN where fewer than two cameras see a joint or their rays are parallel."""
    if len(seen) < 2:
        return np.full((len(JOINT_NAMES), 3), np.nan)
    rays = np.stack([camera.directions(camera.undistorted(marks)) for camera, marks in seen])
    return nearest_points(rays, np.stack([camera.position for camera, _ in seen]))


def height_px(marks: FloatArray) -> float:
    """Measure the longer side of the box around marks (J, 2), px, NaN for none; 0 where fewer than two are known."""
    known = marks[np.isfinite(marks).all(axis=1)]
    return float(np.ptp(known, axis=0).max()) if len(known) > 1 else 0.0


def found_marks(view: View) -> FloatArray:
    """Return the marks (J, 2), px, of a view's keypoints, NaN where they weigh nothing or there are none."""
    if view.keypoints is None:
        return np.full((len(JOINT_NAMES), 2), np.nan)
    weighs = np.nan_to_num(view.keypoints[:, 2:]) > 0.0
    return np.where(weighs, view.keypoints[:, :2], np.nan)


def limb_lengths(joints: FloatArray) -> dict[str, float]:
    """Return the limbs' lengths, m, the median over sides and frames of joints (F, J, 3), m; those known in some."""
    lengths = {}
    for limb, ends in LIMBS.items():
        each = [np.linalg.norm(_of(joints, side, ends[0]) - _of(joints, side, ends[1]), axis=1) for side in _SIDES]
        known = np.concatenate(each)
        known = known[np.isfinite(known)]
        if len(known):
            lengths[limb] = float(np.median(known))
    return lengths


def bends(joints: FloatArray) -> FloatArray:
    """Return of every bent leg (n,) in frames of joints (F, J, 3), m, how far forwards its knee is off the line from
    hip to ankle, over that line's length. Forwards is square to the hips and to the trunk, as left and right are named;
    where they are exchanged it is backwards, and knees bend the wrong way."""
    across, up = _of(joints, "left", "hip") - _of(joints, "right", "hip"), joints[:, JOINT_NAMES.index("neck")]
    up = up - 0.5 * (_of(joints, "left", "hip") + _of(joints, "right", "hip"))
    ahead = np.cross(across, up)
    ahead /= np.maximum(np.linalg.norm(ahead, axis=1, keepdims=True), 1e-12)
    found = []
    for side in _SIDES:
        hip, knee, ankle = (_of(joints, side, name) for name in ("hip", "knee", "ankle"))
        leg = ankle - hip
        length = np.maximum(np.linalg.norm(leg, axis=1, keepdims=True), 1e-12)
        off = (knee - hip) - ((knee - hip) * leg).sum(axis=1, keepdims=True) * leg / length**2
        bent = np.linalg.norm(off, axis=1) > _BENT * length[:, 0]
        found.append(((off * ahead).sum(axis=1) / length[:, 0])[bent])
    return np.concatenate(found)


def _of(joints: FloatArray, side: str, name: str) -> FloatArray:
    return joints[:, JOINT_NAMES.index(f"{side}_{name}")]
