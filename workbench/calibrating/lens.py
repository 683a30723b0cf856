"""One camera's lens out of a board seen in many images, by OpenCV's calibration (Zhang 2000)."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np

from workbench.arrays import FloatArray
from workbench.body.camera import Camera
from workbench.calibrating.boards import Board, Sightings
from workbench.errors import InputError

LEAST_IMAGES = 5
OUTLYING = 3.0
"""Times the median error: images that are worse, and worse than 1 px, are left out; a board may be bent or blurred."""


@dataclass(frozen=True, eq=False)
class Lens:
    """camera: in the middle of its own frame. errors_px: root mean square distance of corners by image. left_out: that
    of images that were not used. sigma_px: standard deviation of the focal length. covered: part of the image's width
    and height that the corners span together."""

    camera: Camera
    errors_px: Mapping[int, float]
    left_out: Mapping[int, float]
    sigma_px: float
    covered: tuple[float, float]

    @property
    def error_px(self) -> float:
        """Root mean square distance of all corners used from where the lens has them."""
        return float(np.sqrt(np.mean(np.square(list(self.errors_px.values())))))


def calibrate_lens(name: str, seen: Sightings, board: Board) -> Lens:
    """Find focal lengths, principal point and distortion (k1, k2, p1, p2; k3 is 0) from a camera's sightings.

    Raises InputError where fewer than LEAST_IMAGES show the board.
    """
    _check_enough(name, seen, board, len(seen.corners))
    errors, *_ = _fitted(seen, board, list(seen.corners))
    limit = max(OUTLYING * float(np.median(list(errors.values()))), 1.0)
    used = [number for number, error in errors.items() if error <= limit]
    left_out = {number: error for number, error in errors.items() if error > limit}
    _check_enough(name, seen, board, len(used))
    errors, matrix, distortion, sigma_px = _fitted(seen, board, used)
    camera = Camera(name, *seen.size, matrix, np.eye(3), np.zeros(3), distortion)
    pixels = np.concatenate([seen.corners[number] for number in used])
    across, down = np.ptp(pixels, axis=0) / seen.size
    return Lens(camera, errors, left_out, sigma_px, (float(across), float(down)))


def _check_enough(name: str, seen: Sightings, board: Board, n: int) -> None:
    if n < LEAST_IMAGES:
        words = f"a board of {board.columns}×{board.rows} inner corners in {LEAST_IMAGES} images or more"
        raise InputError(
            f"{seen.source}: camera {name}: expected {words}, found it in {n} of {seen.n_searched} searched"
        )


def _fitted(seen: Sightings, board: Board, used: list[int]) -> tuple[dict[int, float], FloatArray, FloatArray, float]:
    """Return errors by image, the matrix (3, 3), the distortion (5,) and the focal length's deviation, px."""
    points = [board.corners_m.astype(np.float32)] * len(used)
    pixels = [seen.corners[number].astype(np.float32) for number in used]
    unknown: Any = None
    found = cv2.calibrateCameraExtended(points, pixels, seen.size, unknown, unknown, flags=cv2.CALIB_FIX_K3)
    _, matrix, distortion, _, _, deviations, _, errors = (np.asarray(each, np.float64) for each in found)
    by_image = dict(zip(used, errors.ravel().tolist(), strict=True))
    return by_image, matrix, distortion.ravel()[:5], float(deviations[:2].max())
