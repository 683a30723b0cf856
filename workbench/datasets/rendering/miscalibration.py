"""What a tracker is told of a camera: what a calibration finds, which is not quite the camera."""

from dataclasses import replace

import cv2
import numpy as np

from workbench.body.camera import Camera
from workbench.utils.arrays import FloatArray
from workbench.utils.rng import stream


def calibrated(camera: Camera, seen: FloatArray, part: float, degrees: float, seed: int) -> Camera:
    """Tell what a tracker is told of a camera that sees a person about `seen` (3,), m: as a calibration finds it.

    The focal lengths are wrong by the part `part`, the principal point by that part of the image's width, the place
    by that part of the distance to the person, and the direction by `degrees`: all by exactly so much, in directions
    that the seed draws. With both zero the camera itself is returned.
    """
    if part == 0.0 and degrees == 0.0:
        return camera
    rng = stream(seed, "calibration")
    sign, angle = rng.choice([-1.0, 1.0]), rng.uniform(0.0, 2.0 * np.pi)
    shift, axis = (v / np.linalg.norm(v) for v in rng.standard_normal((2, 3)))
    matrix = camera.matrix.copy()
    matrix[[0, 1], [0, 1]] *= 1.0 + part * sign
    matrix[:2, 2] += part * camera.width * np.array([np.cos(angle), np.sin(angle)])
    turn = np.asarray(cv2.Rodrigues(np.radians(degrees) * axis)[0], dtype=np.float64)
    rotation = turn @ camera.rotation
    place = camera.position + part * np.linalg.norm(seen - camera.position) * shift
    return replace(camera, matrix=matrix, rotation=rotation, translation=-rotation @ place)


def calibration_error(camera: Camera, told: Camera) -> dict[str, FloatArray]:
    """Tell how far the camera told is off, by name: factor of the focal length, px, m and a turn, rad; {} for none."""
    if told is camera:
        return {}
    turn = cv2.Rodrigues(told.rotation @ camera.rotation.T)[0]
    return {
        "camera_focal": np.array([told.matrix[0, 0] / camera.matrix[0, 0]]),
        "camera_principal_point_px": told.matrix[:2, 2] - camera.matrix[:2, 2],
        "camera_place_m": told.position - camera.position,
        "camera_turn_rad": np.asarray(turn, dtype=np.float64)[:, 0],
    }
