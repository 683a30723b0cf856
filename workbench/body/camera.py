"""The pinhole camera with distortion, in OpenCV's convention: x right, y down, z forward."""

import logging
from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from workbench.body.camera_formats import SUFFIXES, camera_tables
from workbench.body.distortion import five_coefficients
from workbench.body.shape import Triple
from workbench.utils.arrays import FloatArray
from workbench.utils.errors import InputError
from workbench.utils.input_limits import LARGEST_PX, MAX_CONFIG, check_file, check_places, parse_toml

log = logging.getLogger(__name__)

_N_COEFFICIENTS = (4, 5, 8, 12, 14)
"""Numbers of coefficients of OpenCV's lens models."""
_MAX_LENS_ERROR_PX = 3.0
"""Largest error of a lens, of the order of a detector's noise."""

TO_LEVEL = np.array([[0.0, -1.0, 0.0], [0.0, 0.0, -1.0], [1.0, 0.0, 0.0]])
"""From a world with x ahead and z up to a level camera."""


@dataclass(frozen=True, eq=False)
class Camera:
    """One calibrated camera. width, height: image size, px. matrix: (3, 3) K, px. distortion: (5,) OpenCV's k1, k2, p1,
    p2, k3. rotation (3, 3) and translation (3,), m, map world points to the camera: x_camera = R x_world + t."""

    name: str
    width: int
    height: int
    matrix: FloatArray
    rotation: FloatArray
    translation: FloatArray
    distortion: FloatArray

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
            normalized[finite] = cv2.undistortPoints(finite_pixels, self.matrix, self.distortion)[:, 0]
        return normalized

    def directions(self, normalized: FloatArray) -> FloatArray:
        """Return unit directions (..., 3) in the world of the rays through x/z, y/z (..., 2)."""
        directions = np.concatenate([normalized, np.ones((*normalized.shape[:-1], 1))], axis=-1) @ self.rotation
        return directions / np.linalg.norm(directions, axis=-1, keepdims=True)

    def scaled(self, factor: float) -> "Camera":
        """Return the camera of the image resized by `factor` (pixel centres stay aligned, as in cv2.resize)."""
        matrix = self.matrix.copy()
        matrix[:2, :2] *= factor
        matrix[:2, 2] = (self.matrix[:2, 2] + 0.5) * factor - 0.5
        width, height = round(self.width * factor), round(self.height * factor)
        return replace(self, width=width, height=height, matrix=matrix)


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


def nearest_points(rays: FloatArray, origins: FloatArray) -> FloatArray:
    """Return the points (..., 3), m, with least mean squared distance to V rays of unit directions (V, ..., 3).
    origins: (V, 3), m. A ray of NaN is absent. Points are NaN where fewer than two rays are present, or all are
    parallel."""
    finite = np.asarray(np.isfinite(rays).all(axis=-1), bool)
    projections = np.where(finite[..., None, None], np.eye(3) - rays[..., :, None] * rays[..., None, :], 0.0)
    normal, moments = np.zeros(projections.shape[1:]), np.zeros(projections.shape[1:-1])
    for projection, origin in zip(projections, origins, strict=True):
        normal += projection
        moments += projection @ origin
    points = np.full(moments.shape, np.nan)
    solvable = (finite.sum(axis=0) > 1) & (np.abs(np.linalg.det(normal)) > 1e-9)
    points[solvable] = np.linalg.solve(normal[solvable], moments[solvable, :, None])[..., 0]
    return points


_MIN_SINE = 0.05
"""Sine of the smallest angle between two rays, 3°, that determine a distance."""


def ray_distances(a: FloatArray, b: FloatArray, baseline: FloatArray) -> FloatArray:
    """Return the distances (...), m, between the lines of rays of unit directions a and b (..., 3); NaN for a missing
    ray, and below 3° between them. baseline: (3,) from the origin of the first to that of the second, m."""
    normal = np.cross(a, b)
    sine = np.linalg.norm(normal, axis=-1)
    with np.errstate(invalid="ignore", divide="ignore"):
        return np.where(sine > _MIN_SINE, np.abs(normal @ baseline) / sine, np.nan)


def load_cameras(path: str | Path) -> tuple[Camera, ...]:
    """Read the cameras of a file in TOML, OpenCV's YAML, XML and JSON, or ROS' camera_info, in the order of the file.

    Each camera has size [w, h], matrix, distortions (4, 5, 8, 12 or 14 numbers), rotation (Rodrigues vector or matrix)
    and translation, in the file's unit; other tables and keys are ignored. In TOML (Pose2Sim, Sports2D, Anipose) it is
    a table with these keys, for the other forms see `camera_tables`. Raises InputError if the file is missing, has
    another form, or a camera is incomplete.
    """
    tables = _tables(Path(path))
    for key, table in tables.items():
        if not _has_pose(table):
            raise InputError(
                f"{path}: camera [{key}] has no rotation and translation in the world, which the dataset video "
                "determines from a person's height; add them for other datasets, see workbench calibrate"
            )
    return tuple(_camera(Path(path), key, table) for key, table in tables.items())


def load_lenses(path: str | Path) -> tuple[Camera, ...]:
    """Return the cameras of a file without poses, at the world's origin; () if one has a pose.

    Raises InputError as `load_cameras` does.
    """
    tables = _tables(Path(path))
    if any(map(_has_pose, tables.values())):
        return ()
    pose = {"rotation": [0.0, 0.0, 0.0], "translation": [0.0, 0.0, 0.0]}
    return tuple(_camera(Path(path), key, {**table, **pose}) for key, table in tables.items())


def _has_pose(table: Mapping[str, Any]) -> bool:
    return not {"rotation", "translation"}.isdisjoint(table)


def _tables(path: Path) -> dict[str, Mapping[str, Any]]:
    """Return the tables of the cameras in a file by name, at least one."""
    if not path.exists():
        raise InputError(f"{path}: no such camera file")
    check_file(path, MAX_CONFIG)
    try:
        text = path.read_bytes().decode("utf-8-sig").replace("\r\n", "\n").replace("\r", "\n")
    except UnicodeDecodeError:
        text = path.read_text(encoding="latin-1")
    except OSError as error:
        raise InputError(f"{path}: cannot be read: {error.strerror}") from None
    if path.suffix.lower() in SUFFIXES:
        return dict(camera_tables(path, text))
    tables = parse_toml(path, text)
    if isinstance(inner := tables.get("cameras"), dict):
        tables = inner
    cameras = {key: table for key, table in tables.items() if _is_camera(key, table)}
    if not cameras:
        raise InputError(f"{path}: expected at least one camera table with a 'matrix', found none")
    return cameras


def _is_camera(key: str, table: object) -> bool:
    """Return whether a table has some of a camera's own keys."""
    return key != "metadata" and isinstance(table, dict) and not {"matrix", "distortions"}.isdisjoint(table)


def _camera(path: Path, key: str, table: Mapping[str, Any]) -> Camera:
    def numbers(name: str, *shapes: tuple[int, ...]) -> FloatArray:
        expected = " or ".join("×".join(map(str, shape)) for shape in shapes)
        try:
            values = np.array(table[name], dtype=np.float64)
        except KeyError:
            raise InputError(f"{path}: camera [{key}] has no {name!r}; expected {expected} numbers") from None
        except (TypeError, ValueError, OverflowError):
            values = np.empty(0)
        if values.shape not in shapes or not np.isfinite(values).all():
            raise InputError(f"{path}: camera [{key}]: {name!r} must hold {expected} numbers, found {table[name]!r}")
        return values

    width, height = numbers("size", (2,))
    if not (1.0 <= width <= LARGEST_PX and 1.0 <= height <= LARGEST_PX):
        raise InputError(f"{path}: camera [{key}]: expected a size of 1 to {LARGEST_PX:g} px, found {table['size']}")
    if not np.abs(numbers("matrix", (3, 3))).max() <= LARGEST_PX:
        raise InputError(f"{path}: camera [{key}]: expected a matrix up to {LARGEST_PX:g} px, found {table['matrix']}")
    check_places(f"{path}: camera [{key}]", numbers("translation", (3,)))
    turn = numbers("rotation", (3,), (3, 3))
    rotation = cv2.Rodrigues(turn)[0].astype(np.float64) if turn.ndim == 1 else turn
    coefficients, fisheye = numbers("distortions", *((n,) for n in _N_COEFFICIENTS)), bool(table.get("fisheye"))
    distortion = np.resize(np.append(coefficients, 0.0), 5)
    if fisheye or coefficients[5:].any():
        distortion, error_px = five_coefficients(
            (int(width), int(height)), numbers("matrix", (3, 3)), coefficients, fisheye
        )
        if not error_px <= _MAX_LENS_ERROR_PX:
            raise InputError(
                f"{path}: camera [{key}]: its lens differs by {error_px:.2g} px from five coefficients; "
                "undistort the images first, and set fisheye = false and distortions of 0"
            )
        log.warning("%s: camera [%s]: its lens is approximated by five coefficients to %.2g px", path, key, error_px)
    return Camera(
        name=str(table.get("name", key)), width=int(width), height=int(height), matrix=numbers("matrix", (3, 3)),
        rotation=rotation, translation=numbers("translation", (3,)), distortion=distortion,
    )  # fmt: skip
