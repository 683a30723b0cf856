"""Axes, up, a floor and joints, drawn into what a camera saw."""

from collections.abc import Sequence

import cv2
import numpy as np

from workbench.arrays import ByteArray, FloatArray
from workbench.body.camera import Camera
from workbench.body.skeleton import JOINT_NAMES
from workbench.recording.write import colours

AXES = {"x": (230, 60, 60), "y": (60, 200, 80), "z": (80, 140, 255)}
GRID, REPROJECTED, LEFT, RIGHT = (235, 235, 235), colours.ESTIMATE, (90, 220, 255), (255, 120, 200)
TILES = 5
"""Of a metre, on each side of the person's place."""
PIECES = 40
"""Of a line in the world, so that one that leads behind the camera is drawn as far as it is seen."""


def drawn(camera: Camera, image: ByteArray, marks: FloatArray, joints: FloatArray, floor_m: float) -> ByteArray:
    """Return a picture (height, width, 3), RGB: a floor of tiles of 1 m at a height, the world's axes, 1 m long, up at
    the person's place, marks (J, 3) [u, v, weight] in two colours by side, and joints (J, 3), m, as crosses."""
    canvas = np.array(image if image.ndim == 3 else cv2.cvtColor(image, cv2.COLOR_GRAY2RGB), np.uint8)
    thick = max(1, round(max(canvas.shape) / 900))
    place = _place(camera, joints, floor_m)
    corner = np.round(place[:2])
    for k in range(-TILES, TILES + 1):
        for along in (0, 1):
            ends = np.tile([*corner, floor_m], (2, 1))
            ends[:, 1 - along] += k
            ends[:, along] += [-TILES, TILES]
            _line(canvas, camera, ends, GRID, thick)
    for axis, (name, colour) in enumerate(AXES.items()):
        _arrow(canvas, camera, np.zeros(3), np.eye(3)[axis], name, colour, 2 * thick)
    _arrow(canvas, camera, place, np.array([0.0, 0.0, 2.0]), "up, 2 m", AXES["z"], 2 * thick)
    for pixel in _seen(camera, joints):
        _cross(canvas, pixel, REPROJECTED, thick)
    for name, (u, v, _) in zip(JOINT_NAMES, marks, strict=True):
        if np.isfinite(u):
            colour = LEFT if name.startswith("left") else RIGHT if name.startswith("right") else colours.KEYPOINT
            cv2.circle(canvas, _pixel((u, v)), 4 * thick, colour, thick, cv2.LINE_AA)
    return _captioned(canvas, camera.name, thick)


def _place(camera: Camera, joints: FloatArray, floor_m: float) -> FloatArray:
    """Return the place (3,) on the floor below the joints, or else where the camera's middle ray meets the floor."""
    there = joints[np.isfinite(joints).all(axis=1)]
    if len(there):
        return np.array([*there[:, :2].mean(axis=0), floor_m])
    forward = camera.rotation[2]
    drop = camera.position[2] - floor_m
    far = drop / -forward[2] if forward[2] * drop < 0.0 else 5.0
    return np.array([*(camera.position + min(far, 20.0) * forward)[:2], floor_m])


def _seen(camera: Camera, points: FloatArray) -> FloatArray:
    """Return the pixels (K, 2) of those of the points (J, 3) that are in front of the camera, near the image."""
    pixels = camera.project(points)
    size = np.array([camera.width, camera.height])
    return pixels[(np.abs(np.nan_to_num(pixels, nan=np.inf) - size / 2) < 2 * size).all(axis=-1)]


def _line(canvas: ByteArray, camera: Camera, ends: FloatArray, colour: Sequence[int], thick: int) -> None:
    """Draw as much of a line between ends (2, 3), m, as is in front of the camera."""
    points = np.linspace(ends[0], ends[1], PIECES + 1)
    pixels, size = camera.project(points), np.array([camera.width, camera.height])
    near = np.asarray((np.abs(np.nan_to_num(pixels, nan=np.inf) - size / 2) < 2 * size).all(axis=1))
    for k in np.flatnonzero(near[:-1] & near[1:]):
        cv2.line(canvas, _pixel(pixels[k]), _pixel(pixels[k + 1]), colour, thick, cv2.LINE_AA)


def _arrow(
    canvas: ByteArray, camera: Camera, foot: FloatArray, way: FloatArray, name: str, colour: Sequence[int], thick: int
) -> None:
    if len(ends := _seen(camera, np.stack([foot, foot + way]))) == 2:
        cv2.arrowedLine(canvas, _pixel(ends[0]), _pixel(ends[1]), colour, thick, cv2.LINE_AA, tipLength=0.08)
        _text(canvas, name, _pixel(ends[1] + 4 * thick), thick / 2, colour)


def _cross(canvas: ByteArray, pixel: FloatArray, colour: Sequence[int], thick: int) -> None:
    cv2.drawMarker(canvas, _pixel(pixel), colour, cv2.MARKER_TILTED_CROSS, 9 * thick, thick, cv2.LINE_AA)


def _captioned(canvas: ByteArray, name: str, thick: int) -> ByteArray:
    words = (f"{name}: tiles of 1 m; circles: marks, blue left, pink right;", "crosses: where the calibration has them")
    for line, text in enumerate(words):
        _text(canvas, text, (10, round((line + 1) * 16 * max(thick, 1.3)) + 6), thick / 2, GRID)
    return canvas


def _text(canvas: ByteArray, words: str, at: tuple[int, int], scale: float, colour: Sequence[int]) -> None:
    """Write words on a dark edge, so that they are read on any ground."""
    plain = words.encode("ascii", "replace").decode()  # OpenCV's letters
    around = [(x, y) for x in (-1, 0, 1) for y in (-1, 0, 1) if x or y]
    for x, y in (*around, (0, 0)):
        shade, place = colour if (x, y) == (0, 0) else (0, 0, 0), (at[0] + x, at[1] + y)
        cv2.putText(canvas, plain, place, cv2.FONT_HERSHEY_SIMPLEX, max(scale, 0.45), shade, 1, cv2.LINE_AA)


def _pixel(place: Sequence[float] | FloatArray) -> tuple[int, int]:
    return round(float(place[0])), round(float(place[1]))
