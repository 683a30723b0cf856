"""Consistency of calibrated cameras without a tracker: ray separations, limb lengths, directions of knees."""

from collections.abc import Sequence

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
_MIN_BEND = 0.05
"""Distance of a knee from the line from hip to ankle, over its length, from which on the leg is bent: some 12
degrees."""


def triangulate_rays(observations: Sequence[tuple[Camera, FloatArray]]) -> FloatArray:
    """Return the points (J, 3), m, nearest in the mean square to the cameras' rays through pixels (J, 2).

    NaN where fewer than two cameras have a pixel that is not NaN, and where their rays are parallel.
    """
    if len(observations) < 2:
        return np.full((len(JOINT_NAMES), 3), np.nan)
    rays = np.stack([camera.directions(camera.undistorted(pixels)) for camera, pixels in observations])
    return nearest_points(rays, np.stack([camera.position for camera, _ in observations]))


def height_px(pixels: FloatArray) -> float:
    """Return the longer side of the box around pixels (J, 2), NaN ignored; 0 for fewer than two."""
    valid = pixels[np.isfinite(pixels).all(axis=1)]
    return float(np.ptp(valid, axis=0).max()) if len(valid) > 1 else 0.0


def keypoint_pixels(view: View) -> FloatArray:
    """Return the pixels (J, 2) of a view's keypoints, NaN where the weight is 0 or there is none."""
    if view.keypoints is None:
        return np.full((len(JOINT_NAMES), 2), np.nan)
    has_weight = np.nan_to_num(view.keypoints[:, 2:]) > 0.0
    return np.where(has_weight, view.keypoints[:, :2], np.nan)


def limb_lengths(joints: FloatArray) -> dict[str, float]:
    """Return the limbs' lengths, m, medians over sides and frames of joints (F, J, 3), m; of limbs in any frame."""
    lengths = {}
    for limb, ends in LIMBS.items():
        each = [np.linalg.norm(_of(joints, side, ends[0]) - _of(joints, side, ends[1]), axis=1) for side in _SIDES]
        valid = np.concatenate(each)
        valid = valid[np.isfinite(valid)]
        if len(valid):
            lengths[limb] = float(np.median(valid))
    return lengths


def bends(joints: FloatArray) -> FloatArray:
    """Return how far forwards the knee of every bent leg (n,) is off the line from hip to ankle, over its length.

    joints: (F, J, 3), m. Forwards is perpendicular to the hips and to the trunk, by the names left and right. With
    exchanged names it is backwards, and bends are negative.
    """
    across = _of(joints, "left", "hip") - _of(joints, "right", "hip")
    up = 0.5 * (_of(joints, "left", "shoulder") + _of(joints, "right", "shoulder"))  # not every detector has a neck
    up = up - 0.5 * (_of(joints, "left", "hip") + _of(joints, "right", "hip"))
    ahead = np.cross(across, up)
    ahead /= np.maximum(np.linalg.norm(ahead, axis=1, keepdims=True), 1e-12)
    by_side = []
    for side in _SIDES:
        hip, knee, ankle = (_of(joints, side, name) for name in ("hip", "knee", "ankle"))
        leg = ankle - hip
        length = np.maximum(np.linalg.norm(leg, axis=1, keepdims=True), 1e-12)
        offset = (knee - hip) - ((knee - hip) * leg).sum(axis=1, keepdims=True) * leg / length**2
        bent = np.linalg.norm(offset, axis=1) > _MIN_BEND * length[:, 0]
        by_side.append(((offset * ahead).sum(axis=1) / length[:, 0])[bent])
    each = np.concatenate(by_side)
    return each[np.isfinite(each)]


def _of(joints: FloatArray, side: str, name: str) -> FloatArray:
    return joints[:, JOINT_NAMES.index(f"{side}_{name}")]
