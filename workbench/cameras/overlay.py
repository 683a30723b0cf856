"""Overlays of a floor, axes and joints on a camera's image."""

from collections.abc import Sequence
from itertools import pairwise, product

import cv2
import numpy as np

from workbench.body.skeleton import JOINT_NAMES
from workbench.cameras.camera import Camera
from workbench.utils.arrays import ByteArray, FloatArray

Colour = tuple[int, int, int]

AXES = {"x": (230, 60, 60), "y": (60, 200, 80), "z": (80, 140, 255)}
_GRID, LEFT, RIGHT = (235, 235, 235), (90, 220, 255), (255, 120, 200)
_N_TILES = 5
"""Tiles of one metre on each side of the person."""
_N_PIECES = 40
"""Pieces of a line in the world, so that a line that leads behind the camera is drawn as far as it is visible."""
_CAPTION = "{}: tiles of 1 m; circles: annotations, blue left, pink right;", "crosses: joints of the calibration"


def draw_overlay(
    camera: Camera, image: ByteArray, keypoints: FloatArray, joints: FloatArray, floor_m: float,
    joint_colour: Colour, keypoint_colour: Colour,
) -> ByteArray:  # fmt: skip
    """Return an image (height, width, 3), RGB, with floor, world axes, vertical, keypoints and joints.

    Parameters
    ----------
    image : (height, width) grey or (height, width, 3) RGB
    keypoints : (J, 3), [u px, v px, weight], drawn as circles coloured by side
    joints : (J, 3), m, drawn as crosses
    floor_m : height of the floor, drawn in tiles of 1 m
    joint_colour, keypoint_colour : (3,) RGB, 0–255; the latter of keypoints of neither side
    """
    canvas = np.array(image if image.ndim == 3 else cv2.cvtColor(image, cv2.COLOR_GRAY2RGB), np.uint8)
    thickness = max(1, round(max(canvas.shape) / 900))
    place = _place(camera, joints, floor_m)
    for k in range(-_N_TILES, _N_TILES + 1):
        for along in (0, 1):
            ends = np.tile([*np.round(place[:2]), floor_m], (2, 1))
            ends[:, 1 - along] += k
            ends[:, along] += [-_N_TILES, _N_TILES]
            pixels = _visible_pixels(camera, np.linspace(ends[0], ends[1], _N_PIECES + 1))
            for a, b in pairwise(pixels):
                if np.isfinite([a, b]).all():
                    cv2.line(canvas, _rounded(a), _rounded(b), _GRID, thickness, cv2.LINE_AA)
    arrows = [(name, np.zeros(3), axis, AXES[name]) for name, axis in zip(AXES, np.eye(3), strict=True)]
    for name, origin, direction, colour in [*arrows, ("up, 2 m", place, np.array([0.0, 0.0, 2.0]), AXES["z"])]:
        pixels = _visible_pixels(camera, np.stack([origin, origin + direction]))
        if np.isfinite(pixels).all():
            tail, tip = map(_rounded, pixels)
            cv2.arrowedLine(canvas, tail, tip, colour, 2 * thickness, cv2.LINE_AA, tipLength=0.08)
            _write(canvas, name, _rounded(pixels[1] + 8 * thickness), 2 * thickness, colour)
    for pixel in _visible_pixels(camera, joints):
        if np.isfinite(pixel).all():
            style = joint_colour, cv2.MARKER_TILTED_CROSS, 9 * thickness, thickness, cv2.LINE_AA
            cv2.drawMarker(canvas, _rounded(pixel), *style)
    for name, keypoint in zip(JOINT_NAMES, keypoints, strict=True):
        if np.isfinite(keypoint[0]):
            colour = LEFT if name.startswith("left") else RIGHT if name.startswith("right") else keypoint_colour
            cv2.circle(canvas, _rounded(keypoint), 4 * thickness, colour, thickness, cv2.LINE_AA)
    for row, text in enumerate(_CAPTION):
        at = 10, round((row + 1) * 16 * max(thickness, 1.3)) + 6
        _write(canvas, text.format(camera.name), at, thickness, _GRID)
    return canvas


def _place(camera: Camera, joints: FloatArray, floor_m: float) -> FloatArray:
    """Return the point (3,) of the floor below the joints, or else where the optical axis meets the floor."""
    complete = joints[np.isfinite(joints).all(axis=1)]
    if len(complete):
        return np.array([*complete[:, :2].mean(axis=0), floor_m])
    forward, drop = camera.rotation[2], camera.position[2] - floor_m
    distance = drop / -forward[2] if forward[2] * drop < 0.0 else 5.0
    return np.array([*(camera.position + min(distance, 20.0) * forward)[:2], floor_m])


def _visible_pixels(camera: Camera, points: FloatArray) -> FloatArray:
    """Return the pixels (K, 2) of points (K, 3), m; NaN behind the camera and far outside the image."""
    pixels, size = camera.project(points), np.array([camera.width, camera.height])
    return np.where((np.abs(pixels - size / 2) < 2 * size).all(axis=-1, keepdims=True), pixels, np.nan)


def _write(canvas: ByteArray, text: str, at: tuple[int, int], thickness: int, colour: Sequence[int]) -> None:
    """Draw a text with a dark outline, which is legible on any background."""
    text = text.encode("ascii", "replace").decode()  # OpenCV's fonts have no other characters
    style, scale = cv2.FONT_HERSHEY_SIMPLEX, max(thickness / 2, 0.45)
    for x, y in product((-1, 0, 1), repeat=2):
        cv2.putText(canvas, text, (at[0] + x, at[1] + y), style, scale, (0, 0, 0), 1, cv2.LINE_AA)
    cv2.putText(canvas, text, at, style, scale, colour, 1, cv2.LINE_AA)


def _rounded(pixel: FloatArray) -> tuple[int, int]:
    return round(float(pixel[0])), round(float(pixel[1]))
