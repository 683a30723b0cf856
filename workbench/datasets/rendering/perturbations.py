"""Perturbations of a rendered scene: differences of the true person and camera from those given to a tracker."""

from collections.abc import Mapping
from dataclasses import replace
from types import MappingProxyType

import cv2
import numpy as np

from workbench.cameras.camera import Camera
from workbench.core.checks import Range
from workbench.utils.arrays import FloatArray
from workbench.utils.rng import stream

DEFAULT_SIZES: Mapping[str, float] = MappingProxyType(
    {
        "lengths": 0.03, "radii": 0.1, "profile": 1.0, "clothes_m": 0.005,
        "camera": 0.002, "camera_deg": 0.1, "start_m": 0.03, "start_rad": 0.05,
    }
)  # fmt: skip
"""Sizes of all perturbations by name, see `sequence.Scene`."""
VISIBLE = ("lengths", "radii", "profile", "clothes_m")
"""Perturbations that change the images; the others change only the metadata."""
_FRACTIONS = ("lengths", "radii", "camera")  # of a length
SIZES_RANGE = Range(
    f"sizes from 0 on, {', '.join(_FRACTIONS)} below 0.5, by names of {', '.join(DEFAULT_SIZES)}",
    lambda sizes: all(
        name in DEFAULT_SIZES and 0.0 <= size < (0.5 if name in _FRACTIONS else np.inf)
        for name, size in (sizes or {}).items()
    ),
)
"""Range of a dataset's key `perturbations`."""


def perturbation_sizes(perturb: bool, perturbations: Mapping[str, float] | None) -> dict[str, float]:
    """Return the size of every perturbation: those in `perturbations`, and for the others the default or, without
    `perturb`, zero."""
    return {**(DEFAULT_SIZES if perturb else dict.fromkeys(DEFAULT_SIZES, 0.0)), **(perturbations or {})}


def miscalibrated(camera: Camera, target: FloatArray, fraction: float, degrees: float, seed: int) -> Camera:
    """Return a camera with the errors of a calibration; the camera itself where both sizes are zero.

    Errors have exactly the given sizes; the seed draws their directions.

    Parameters
    ----------
    target : (3,) position of the person, m.
    fraction : relative error of the focal lengths, and error of the principal point over the image's width and of
        the camera's position over the distance to the person.
    degrees : error of the orientation.
    """
    if fraction == 0.0 and degrees == 0.0:
        return camera
    rng = stream(seed, "calibration")
    sign, angle = rng.choice([-1.0, 1.0]), rng.uniform(0.0, 2.0 * np.pi)
    shift, axis = (v / np.linalg.norm(v) for v in rng.standard_normal((2, 3)))
    matrix = camera.matrix.copy()
    matrix[[0, 1], [0, 1]] *= 1.0 + fraction * sign
    matrix[:2, 2] += fraction * camera.width * np.array([np.cos(angle), np.sin(angle)])
    turn = np.asarray(cv2.Rodrigues(np.radians(degrees) * axis)[0], dtype=np.float64)
    rotation = turn @ camera.rotation
    position = camera.position + fraction * np.linalg.norm(target - camera.position) * shift
    return replace(camera, matrix=matrix, rotation=rotation, translation=-rotation @ position)


def calibration_error(camera: Camera, estimate: Camera) -> dict[str, FloatArray]:
    """Return a calibration's errors by name: ratio of focal lengths, px, m, and a rotation vector, rad; {} for none."""
    if estimate is camera:
        return {}
    turn = cv2.Rodrigues(estimate.rotation @ camera.rotation.T)[0]
    return {
        "camera_focal": np.array([estimate.matrix[0, 0] / camera.matrix[0, 0]]),
        "camera_principal_point_px": estimate.matrix[:2, 2] - camera.matrix[:2, 2],
        "camera_place_m": estimate.position - camera.position,
        "camera_turn_rad": np.asarray(turn, dtype=np.float64)[:, 0],
    }
