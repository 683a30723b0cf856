"""Cameras of a calibration file in metres with z up, for the images of a source: units, axes and image sizes."""

import logging
import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from itertools import combinations
from pathlib import Path

import cv2
import numpy as np

from workbench.body.skeleton import JOINT_NAMES
from workbench.body.stature import stature
from workbench.body.units import TYPICAL_M, UNIT_NAMES, UNITS, unit_of_extent, unit_of_person
from workbench.cameras.camera import Camera
from workbench.cameras.camera_file import load_cameras, stated_unit
from workbench.cameras.triangulation import ray_directions, triangulate_normalized, undistorted
from workbench.utils.arrays import FloatArray
from workbench.utils.errors import InputError
from workbench.utils.input_path import expanded

log = logging.getLogger(__name__)

_UNITS = ("m", "cm", "mm")
AXES: Mapping[str, FloatArray] = {
    f"{sign}{axis}": factor * np.eye(3)[k] for k, axis in enumerate("xyz") for sign, factor in (("", 1.0), ("-", -1.0))
}
_DISTANCES = {"m": (0.0, 60.0), "mm": (3000.0, np.inf)}
"""Distances between cameras by their unit: up to a sports field in metres, and in millimetres from what in centimetres
is more than 30 m."""
_BEST_RAYS = 0.1
"""Fraction of the joints, of which the rays meet best, that are right: with every second wrong in each of three
cameras, one of eight is right in all."""
_MAX_RAY_DISTANCE = 0.05
"""Largest median distance of the rays to a joint, over the height, of detections of one person."""
_MAX_ASPECT_CHANGE = 0.01
_STEEP, _CLEAR_COSINE = 0.7, 0.8
"""Sine of the steepest view from above of a camera that shows people from the side; cosine of the largest angle between
an axis of the world and the upward direction of the images."""


def read_calibration(path: str | Path, unit: str | float | None, up: str | None) -> tuple[Camera, ...]:
    """Return the cameras of a file in metres with z up.

    Parameters
    ----------
    path : see `load_cameras`.
    unit : of lengths in the file, m, cm, mm or a number of metres; None: that of the file's format, or metres where
        these are plausible.
    up : the file's vertical axis, such as -y; None: z, with a warning where the images are upright by another axis.

    Raises
    ------
    InputError
        As `load_cameras`, for an unknown unit or axis, and for distances between cameras that are no metres.
    """
    path = expanded(path)
    cameras = load_cameras(path)
    if unit is None and (unit := stated_unit(path)) is not None:
        log.info("%s: lengths are in %s, as in every file of its kind (dataset.unit)", path, UNIT_NAMES.get(unit, unit))
    factor = unit_factor(cameras, unit, str(path))
    if up is not None and up not in AXES:
        raise InputError(f"dataset.up: expected one of {', '.join(AXES)}, found {up!r}")
    if up is None and (upright := _upright_axis(cameras)) != "z":
        log.warning(
            "%s: the images of the cameras are upright if %s of the world is up, but z is taken for up; set "
            "dataset.up=%s to turn the world", path, upright, upright,
        )  # fmt: skip
    return tuple(_turned(replace(one, translation=one.translation * factor), up or "z") for one in cameras)


def camera_named(cameras: Iterable[Camera], name: str | None, source: str) -> Camera:
    """Return the camera of a name, or the first one.

    Where no camera has exactly this name, letter case, symbols and leading zeros are ignored, so that a video cam01.mp4
    belongs to the camera cam_01 or Cam1. Raises InputError for an unknown name.
    """
    by_name = {camera.name: camera for camera in cameras}
    if name is None or name in by_name:
        return next(iter(by_name.values())) if name is None else by_name[name]
    alike = [camera for other, camera in by_name.items() if _plain(other) == _plain(name)]
    if len(alike) != 1:
        raise InputError(f"{source}: no camera called {name!r}, expected one of {', '.join(by_name)}")
    return replace(alike[0], name=name)


def _plain(name: str) -> str:
    """Return the letters and digits of a name in lower case, without leading zeros of its numbers."""
    return re.sub(r"(?<!\d)0+(?=\d)", "", "".join(letter for letter in name.lower() if letter.isalnum()))


def unit_factor(cameras: Sequence[Camera], unit: str | float | None, source: str) -> float:
    """Return the metres of a calibration's unit; for none, 1 or 0.001 by the distances of the cameras.

    Raises InputError for an unknown unit, and for distances that may be centimetres as well as millimetres.
    """
    if unit is not None:
        factor = (UNITS[unit] if unit in _UNITS else None) if isinstance(unit, str) else float(unit)
        if factor is None or not 0.0 < factor < np.inf:
            raise InputError(f"dataset.unit: expected m, cm, mm or a number of metres, found {unit!r}")
        return factor
    distance = _distance(cameras)
    name = unit_of_extent(distance, _DISTANCES)
    if name is None:
        raise InputError(f"{source}: cameras are {distance:.4g} units apart, no metres; set dataset.unit=cm or mm")
    if name != "m":
        named = UNIT_NAMES[name]
        log.warning("%s: cameras are %.4g units apart, which are taken for %s (dataset.unit)", source, distance, named)
    return UNITS[name]


def unit_of_people(cameras: Sequence[Camera], pixels: FloatArray, source: str) -> float | None:
    """Return the metres of a calibration's unit in which a person has a plausible height.

    pixels: (V, T, J, 2), px, of the person in all cameras; NaN where unknown. None where no limb is measured by rays
    that meet. Raises InputError where neither m, cm nor mm is plausible, and where the poses seem to be inverted.
    """
    height = triangulated_height(cameras, pixels)
    name = unit_of_person(height, _UNITS)
    if name is None:  # many wrong joints
        height = triangulated_height(cameras, pixels, _BEST_RAYS)
        name = unit_of_person(height, _UNITS)
    inverted = [replace(one, rotation=one.rotation.T, translation=one.position) for one in cameras]
    if name is None and unit_of_person(triangulated_height(inverted, pixels), _UNITS) is not None:
        raise InputError(
            f"{source}: the poses seem to be inverted: the rays to the person meet only if rotation and translation "
            "lead from the camera to the world; replace them by their inverses, Rᵀ and -Rᵀ t"
        )
    if not np.isfinite(height):
        return None
    if name is None:
        raise InputError(
            f"{source}: a person is {height:.3g} units tall, neither m, cm nor mm; set dataset.unit to its metres, "
            f"{TYPICAL_M / height:.2g} for a person of {TYPICAL_M} m"
        )
    if name != "m":
        log.warning("%s: lengths are taken for %s: a person is %.3g tall (dataset.unit)", source, name, height)
    return UNITS[name]


def triangulated_height(cameras: Sequence[Camera], pixels: FloatArray, best: float = 1.0) -> float:
    """Return the median height, in the cameras' unit, of a person with joints at pixels (V, T, J, 2); NaN where the
    rays of different cameras do not meet. best: fraction of the joints used, those whose rays meet best."""
    places = undistorted(cameras, pixels)
    points = triangulate_normalized(cameras, places)
    rays = ray_directions(cameras, places)
    offsets = points - np.stack([camera.position for camera in cameras])[:, None, None]
    distances = np.linalg.norm(np.cross(offsets, rays), axis=-1)
    if best < 1.0 and np.isfinite(distances).any():
        farthest = np.nan_to_num(distances).max(axis=0)
        points[farthest > np.quantile(farthest[np.isfinite(points[..., 0])], best)] = np.nan
        distances[:, np.isnan(points[..., 0])] = np.nan
    height = stature({name: points[:, k] for k, name in enumerate(JOINT_NAMES)})
    if height is None or not np.isfinite(distances).any():
        return float("nan")
    return height if np.nanmedian(distances) <= _MAX_RAY_DISTANCE * height else float("nan")


def in_units(camera: Camera, size: tuple[int, int]) -> Camera:
    """Return a camera for images of a width, without a check of their height."""
    if not camera.width:
        return replace(camera, width=size[0], height=size[1])
    return camera if size[0] == camera.width else camera.scaled(size[0] / camera.width)


def fitted(camera: Camera, size: tuple[int, int], source: str) -> Camera:
    """Return a camera for images of another size, width and height, with the same aspect ratio to 1 %; one without a
    size gets that of the images.

    Raises InputError for another aspect ratio.
    """
    if not camera.width:
        log.warning(
            "%s: camera %s has no image size in its file; that of the images, %d×%d, is taken",
            source, camera.name, *size,
        )  # fmt: skip
        return replace(camera, width=size[0], height=size[1])
    across, down = size[0] / camera.width, size[1] / camera.height
    if max(abs(across - 1.0), abs(down - 1.0)) <= _MAX_ASPECT_CHANGE:
        return camera
    if abs(across / down - 1.0) > _MAX_ASPECT_CHANGE:
        expected = f"{camera.width}×{camera.height} of camera {camera.name!r}"
        raise InputError(f"{source}: images are {size[0]}×{size[1]}, expected the {expected} or its aspect ratio")
    log.warning(
        "%s: images are %d×%d, camera %s is calibrated at %d×%d: its matrix is scaled by %.4g",
        source, *size, camera.name, camera.width, camera.height, across,
    )  # fmt: skip
    return camera.scaled(across)


def _upright_axis(cameras: Iterable[Camera]) -> str:
    """Return the axis of the world that is up in the images of cameras on average, z where it is not clear.

    Cameras that look steeply down are ignored: their images have no upward direction.
    """
    upwards = [-one.rotation[1] for one in cameras if one.rotation[2, 2] > -_STEEP]
    mean = np.mean(upwards, axis=0) if upwards else AXES["z"]
    axis = max(AXES, key=lambda name: float(AXES[name] @ mean))
    is_clear = AXES[axis] @ mean > _CLEAR_COSINE * np.linalg.norm(mean) > 0.0 and mean[2] < 0.5 * np.linalg.norm(mean)
    return axis if is_clear else "z"


def _turned(camera: Camera, up: str) -> Camera:
    """Return a camera in the world turned by the smallest rotation that makes an axis z; about x for -z."""
    if up == "z":
        return camera
    axis = np.cross(AXES[up], AXES["z"]) if up != "-z" else AXES["x"]
    angle = np.pi if up == "-z" else np.pi / 2.0
    turn = np.round(cv2.Rodrigues(axis * angle)[0])
    return replace(camera, rotation=camera.rotation @ turn.T)


def _distance(cameras: Iterable[Camera]) -> float:
    """Return the median distance between cameras, or of a single one from the world's origin."""
    positions = [camera.position for camera in cameras]
    pairs = list(combinations(positions, 2)) or [(positions[0], np.zeros(3))]
    return float(np.median([np.linalg.norm(a - b) for a, b in pairs]))
