"""Checkerboards rendered for a calibrated camera by the plane's homography."""

import cv2
import numpy as np

from workbench.cameras.camera import Camera

COLUMNS, ROWS, SQUARE_M, PX = 7, 4, 0.05, 30
"""Inner corners per row and column, side of a square, m, and texture pixels per square."""


def texture(columns=COLUMNS, rows=ROWS):
    """Return squares with a white margin of one square; the square above and left of the first inner corner is dark."""
    v, u = np.mgrid[: (rows + 1) * PX, : (columns + 1) * PX] // PX
    return np.pad(np.where((u + v) % 2, 240, 20).astype(np.uint8), PX, constant_values=240)


def lens(name="one", focal_px=700.0, size=(640, 480)):
    matrix = np.array([[focal_px, 0.0, 310.0], [0.0, focal_px, 245.0], [0.0, 0.0, 1.0]])
    return Camera(name, *size, matrix, np.eye(3), np.zeros(3), np.zeros(5))


def board_poses(n=10, seed=3):
    """Return rotations (3, 3) and translations (3,) from the board to the first camera, 0.7 m away, tilt up to 35°."""
    rng, poses = np.random.default_rng(seed), []
    for _ in range(n):
        rotation = cv2.Rodrigues(rng.uniform(-0.6, 0.6, 3) * [1.0, 1.0, 0.5])[0]
        middle = np.array([(COLUMNS - 1) / 2, (ROWS - 1) / 2, 0.0]) * SQUARE_M
        position = np.array([*rng.uniform(-0.08, 0.08, 2), rng.uniform(0.55, 0.8)])
        poses.append((rotation, position - rotation @ middle))
    return poses


def rendered(camera, rotation, translation):
    """Return a camera's image (height, width, 3) of a board, without distortion, blurred by half a pixel."""
    to_board = np.array([[SQUARE_M / PX, 0.0, 0.0], [0.0, SQUARE_M / PX, 0.0], [0.0, 0.0, 1.0]])
    # the first inner corner is between the texture's pixels 59 and 60
    to_board[:2, 2] = -(2 * PX - 0.5) * SQUARE_M / PX
    axes, origin = camera.rotation @ rotation, camera.rotation @ translation + camera.translation
    plane = camera.matrix @ np.column_stack([axes[:, 0], axes[:, 1], origin]) @ to_board
    size = camera.width * 2, camera.height * 2
    twice = np.array([[2.0, 0.0, 0.5], [0.0, 2.0, 0.5], [0.0, 0.0, 1.0]]) @ plane
    large = cv2.warpPerspective(texture(), twice, size, flags=cv2.INTER_LINEAR, borderValue=128)
    return np.repeat(cv2.resize(large, None, fx=0.5, fy=0.5, interpolation=cv2.INTER_AREA)[..., None], 3, axis=2)
