"""The axes of a ground truth from markers, by the detections in calibrated cameras."""

import logging
from collections.abc import Sequence
from itertools import permutations, product

import numpy as np

from workbench.cameras.camera import Camera
from workbench.cameras.image_height import height_px
from workbench.utils.arrays import FloatArray

log = logging.getLogger(__name__)

_BETTER = 0.5  # a rotation is used if it halves the median distance from the detections …
_CLOSE = 0.05  # … to less than this share of the person's height in the image: 9 cm, a detector's large errors
_FRAMES = 50
ROTATIONS = np.array([
    matrix for order in permutations(range(3)) for signs in product((1.0, -1.0), repeat=3)
    if np.linalg.det(matrix := np.diag(signs) @ np.eye(3)[list(order)]) > 0.0
])  # fmt: skip
"""The 24 rotations (24, 3, 3) that permute the axes; the first is the identity."""


def in_axes_of_cameras(
    place: object, joints: FloatArray, detections: Sequence[tuple[Camera, FloatArray]]
) -> FloatArray:
    """Return joints (F, J, 3), rotated as the cameras' world if they fit the detections much better so; logged.

    Cameras determine the axes even of a person who lies, which markers do not. place : of the joints, for messages.
    detections : cameras with pixels (F, J, 2), NaN where missing.
    """
    some = np.unique(np.linspace(0, len(joints) - 1, _FRAMES).astype(int))
    errors = [_distance_px(joints[some] @ rotation.T, [(c, p[some]) for c, p in detections]) for rotation in ROTATIONS]
    best = int(np.argmin(errors))
    heights = [height_px(pixels[np.isfinite(pixels[..., 0]).any(axis=1)]) for _, pixels in detections]
    height = float(np.median(each)) if len(each := np.concatenate([np.empty(0), *heights])) else 0.0
    if not errors[best] < min(_BETTER * errors[0], _CLOSE * height):
        return joints
    rotation = ROTATIONS[best]
    names = [f"{'-' if row.sum() < 0.0 else ''}{'xyz'[np.abs(row).argmax()]}" for row in rotation]
    log.warning(
        "%s: the detections are %.3g px from the joints, %.3g px if the joints' %s is the cameras' x and their %s is "
        "up, which is used; to give the file's axes, set truth_up and truth_forward",
        place, errors[0], errors[best], names[0], names[2],
    )  # fmt: skip
    return joints @ rotation.T


def _distance_px(joints: FloatArray, detections: Sequence[tuple[Camera, FloatArray]]) -> float:
    """Return the median distance of projected joints from the detections; infinite without any."""
    distances = []
    for camera, pixels in detections:
        offsets = np.linalg.norm(camera.project(joints.reshape(-1, 3)) - pixels.reshape(-1, 2), axis=-1)
        known = np.isfinite(joints).all(axis=-1).ravel() & np.isfinite(pixels).all(axis=-1).ravel()
        distances.append(np.where(np.isfinite(offsets), offsets, np.inf)[known])
    values = np.concatenate(distances) if distances else np.empty(0)
    return float(np.median(values)) if len(values) else np.inf
