"""The pinhole camera with distortion, in OpenCV's convention: x right, y down, z forward."""

from dataclasses import dataclass, replace
from functools import cached_property

import cv2
import numpy as np

from workbench.body.shape import Triple
from workbench.utils.arrays import FloatArray
from workbench.utils.errors import InputError

TO_LEVEL = np.array([[0.0, -1.0, 0.0], [0.0, 0.0, -1.0], [1.0, 0.0, 0.0]])
"""From a world with x ahead and z up to a level camera."""
N_ROW_POSE = 12
"""Numbers of rotation and translation, the first of `Camera.row`; the focal lengths follow."""
_UNDISTORTION = (cv2.TERM_CRITERIA_COUNT + cv2.TERM_CRITERIA_EPS, 100, 1e-12)
"""Iterations, and largest error, px, of removed distortion. OpenCV's five iterations err by 5 to 80 px in the corners
of wide lenses."""


@dataclass(frozen=True, eq=False)
class Camera:
    """One camera. width, height: image size, px; 0: unknown, of a camera in a file without it. matrix: (3, 3) K, px.
    distortion: (5,) OpenCV's k1, k2, p1, p2, k3. rotation (3, 3) and translation (3,), m, map world points to the
    camera: x_camera = R x_world + t. uncertainty: (G, 23) changes of `row` by a standard deviation of each error of an
    estimated camera; None: known."""

    name: str
    width: int
    height: int
    matrix: FloatArray
    rotation: FloatArray
    translation: FloatArray
    distortion: FloatArray
    uncertainty: FloatArray | None = None

    @property
    def position(self) -> FloatArray:
        """The camera's centre in the world, (3,) m."""
        return -self.rotation.T @ self.translation

    @cached_property
    def row(self) -> FloatArray:
        """The camera's parameters for kernels, (23,): rotation, translation, focal lengths and centre, px, distortion,
        width, height."""
        size = [float(self.width), float(self.height)]
        focal, centre = self.matrix[[0, 1], [0, 1]], self.matrix[:2, 2]
        return np.concatenate([self.rotation.ravel(), self.translation, focal, centre, self.distortion, size])

    def is_equal(self, other: "Camera") -> bool:
        """Return whether another camera has the same pose and lens."""
        return self is other or np.array_equal(self.row, other.row)

    def to_camera(self, points: FloatArray) -> FloatArray:
        """Return world points (..., 3) in the camera's frame, m; the last coordinate is the depth."""
        return points @ self.rotation.T + self.translation

    def project(self, points: FloatArray) -> FloatArray:
        """Return pixels (..., 2) of world points (..., 3), (0, 0) being the centre of the top left one; NaN behind the
        camera's plane."""
        return self.pixels(self.to_camera(points), 1e-6)

    def pixels(self, camera_points: FloatArray, min_depth: float) -> FloatArray:
        """Return pixels (..., 2) of points (..., 3) in the camera's frame, with OpenCV's radial and tangential
        distortion; NaN up to a depth, m."""
        depth = np.where(camera_points[..., 2] > min_depth, camera_points[..., 2], np.nan)
        (k1, k2, p1, p2, k3), x, y = self.distortion, camera_points[..., 0] / depth, camera_points[..., 1] / depth
        r2 = x * x + y * y
        radial = 1.0 + r2 * (k1 + r2 * (k2 + r2 * k3))
        distorted_x = x * radial + 2.0 * p1 * x * y + p2 * (r2 + 2.0 * x * x)
        distorted_y = y * radial + p1 * (r2 + 2.0 * y * y) + 2.0 * p2 * x * y
        return np.stack([distorted_x, distorted_y], axis=-1) * self.matrix[[0, 1], [0, 1]] + self.matrix[:2, 2]

    def undistorted(self, pixels: FloatArray) -> FloatArray:
        """Return x/z, y/z (..., 2) in the camera's frame of pixels (..., 2); NaN at NaN."""
        normalized, finite = np.full(pixels.shape, np.nan), np.asarray(np.isfinite(pixels).all(axis=-1), bool)
        if finite.any():
            finite_pixels = np.ascontiguousarray(pixels[finite][:, None])
            places = cv2.undistortPoints(finite_pixels, self.matrix, self.distortion, criteria=_UNDISTORTION)
            normalized[finite] = places[:, 0]
        return normalized

    def directions(self, normalized: FloatArray) -> FloatArray:
        """Return unit directions (..., 3) in the world of the rays through x/z, y/z (..., 2)."""
        directions = np.concatenate([normalized, np.ones((*normalized.shape[:-1], 1))], axis=-1) @ self.rotation
        return directions / np.linalg.norm(directions, axis=-1, keepdims=True)

    def viewing_axes(self, direction: FloatArray) -> FloatArray:
        """Return the axes (3, 3), rows in the world, of the camera turned by the smallest rotation that points it along
        a unit direction (3,) in the world."""
        x, y, z = self.rotation @ direction
        # Rodrigues' formula for the rotation of the optical axis (0, 0, 1) to (x, y, z) in the camera's frame
        turn = np.array([[1.0 - x * x / (1.0 + z), -x * y / (1.0 + z), x],
                         [-x * y / (1.0 + z), 1.0 - y * y / (1.0 + z), y], [-x, -y, z]])  # fmt: skip
        return np.asarray(turn.T @ self.rotation)

    def scaled(self, factor: float) -> "Camera":
        """Return the camera of the image resized by `factor` (pixel centres stay aligned, as in cv2.resize)."""
        matrix = self.matrix.copy()
        matrix[:2, :2] *= factor
        matrix[:2, 2] = (self.matrix[:2, 2] + 0.5) * factor - 0.5
        width, height = round(self.width * factor), round(self.height * factor)
        uncertainty = self.uncertainty
        if uncertainty is not None:
            uncertainty = uncertainty.copy()
            uncertainty[:, N_ROW_POSE : N_ROW_POSE + 4] *= factor
        return replace(self, width=width, height=height, matrix=matrix, uncertainty=uncertainty)

    def turned(self, turn: FloatArray, zoom: float) -> "Camera":
        """Return the camera at the same place after a rotation (3, 3) in its own axes and a change of its focal
        length."""
        matrix, uncertainty = self.matrix.copy(), self.uncertainty
        matrix[[0, 1], [0, 1]] *= zoom
        if uncertainty is not None:
            rotations = turn @ uncertainty[:, :9].reshape(-1, 3, 3)
            uncertainty = np.concatenate([
                rotations.reshape(-1, 9), uncertainty[:, 9:12] @ turn.T, zoom * uncertainty[:, 12:14],
                uncertainty[:, 14:],
            ], axis=1)  # fmt: skip
        rotation, translation = turn @ self.rotation, turn @ self.translation
        return replace(self, matrix=matrix, rotation=rotation, translation=translation, uncertainty=uncertainty)


def level_rotation(tilt: float, roll: float) -> FloatArray:
    """Return the rotation (3, 3) of a camera that looks along the world's x axis, turned downwards by `tilt` and then
    about its optical axis by `roll`, rad."""
    (c, cr), (s, sr) = np.cos([tilt, roll]), np.sin([tilt, roll])
    tilted = np.array([[1.0, 0.0, 0.0], [0.0, c, -s], [0.0, s, c]])
    rolled = np.array([[cr, -sr, 0.0], [sr, cr, 0.0], [0.0, 0.0, 1.0]])
    return np.asarray(rolled @ tilted @ TO_LEVEL)


def plain_camera(
    width: int, height: int, focal_px: float, position: Triple, look_at: Triple, name: str = "camera"
) -> Camera:
    """Return an undistorted camera at `position`, directed at the point `look_at`, both in the world (m), with z up;
    raises InputError if these coincide or are one above the other."""
    forward = np.subtract(look_at, position).astype(np.float64)
    right = np.cross(forward, [0.0, 0.0, 1.0])
    if np.linalg.norm(right) < 1e-9:
        raise InputError(f"camera: position {tuple(position)} is at, above or below look_at {tuple(look_at)}")
    forward, right = forward / np.linalg.norm(forward), right / np.linalg.norm(right)
    rotation = np.stack([right, np.cross(forward, right), forward])
    matrix = np.array([[focal_px, 0.0, (width - 1) / 2], [0.0, focal_px, (height - 1) / 2], [0.0, 0.0, 1.0]])
    translation = -rotation @ np.asarray(position, dtype=np.float64)
    return Camera(name, width, height, matrix, rotation, translation, np.zeros(5))
