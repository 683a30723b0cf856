"""Differences between what a scene shows and what a tracker knows of it: their sizes, and the miscalibrated camera."""

from collections.abc import Mapping
from dataclasses import replace
from types import MappingProxyType

import cv2
import numpy as np

from workbench.body.camera import Camera
from workbench.core.checks import Range
from workbench.utils.arrays import FloatArray
from workbench.utils.rng import stream

USUAL: Mapping[str, float] = MappingProxyType(
    {
        "lengths": 0.03, "radii": 0.1, "profile": 1.0, "clothes_m": 0.005,
        "camera": 0.002, "camera_deg": 0.1, "start_m": 0.03, "start_rad": 0.05,
    }
)  # fmt: skip
"""Sizes of all departures by their names, see `sequence.Scene`."""
SHOWN = ("lengths", "radii", "profile", "clothes_m")
"""Those that can be seen; the others are only in what is told."""
_FRACTIONS = ("lengths", "radii", "camera")  # of a length
GIVEN = Range(
    f"sizes from 0 on, {', '.join(_FRACTIONS)} below 0.5, by names of {', '.join(USUAL)}",
    lambda sizes: all(
        name in USUAL and 0.0 <= size < (0.5 if name in _FRACTIONS else np.inf) for name, size in (sizes or {}).items()
    ),
)
"""What a dataset's key `departures` may hold."""


def sizes(exact: bool, departures: Mapping[str, float] | None) -> dict[str, float]:
    """The size of every departure: those given, and of the rest the usual, or none where the scene is exact."""
    return {**(dict.fromkeys(USUAL, 0.0) if exact else USUAL), **(departures or {})}


def calibrated(camera: Camera, seen: FloatArray, part: float, degrees: float, seed: int) -> Camera:
    """Return a camera that sees a person about `seen` (3,), m, as a calibration estimates it.

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
    """Return a calibration's errors by name: factor of the focal length, px, m, and a rotation, rad; {} for none."""
    if told is camera:
        return {}
    turn = cv2.Rodrigues(told.rotation @ camera.rotation.T)[0]
    return {
        "camera_focal": np.array([told.matrix[0, 0] / camera.matrix[0, 0]]),
        "camera_principal_point_px": told.matrix[:2, 2] - camera.matrix[:2, 2],
        "camera_place_m": told.position - camera.position,
        "camera_turn_rad": np.asarray(turn, dtype=np.float64)[:, 0],
    }
