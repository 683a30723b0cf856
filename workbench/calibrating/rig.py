"""Where several cameras stand, out of the board that they see at the same time, and where up is."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import cv2
import numpy as np

from workbench.arrays import FloatArray
from workbench.body.camera import Camera
from workbench.calibrating.boards import Board, Sightings
from workbench.errors import InputError

LEAST_COMMON = 3
TO_LEVEL = np.array([[0.0, -1.0, 0.0], [0.0, 0.0, -1.0], [1.0, 0.0, 0.0]])
"""From a world whose x axis is ahead and whose z axis is up to a camera that stands level."""
TO_BOARD = np.diag([1.0, -1.0, -1.0])
"""From a world whose z axis is up to a board that lies on its floor; its own z axis leads away from who sees it."""


@dataclass(frozen=True, eq=False)
class Joined:
    """How one camera was joined to another. errors_px: root mean square distance of corners by image, of both."""

    camera: str
    to: str
    errors_px: Mapping[int, float]


def join(cameras: Sequence[Camera], seen: Sequence[Sightings], board: Board) -> tuple[list[Camera], list[Joined]]:
    """Place cameras in the frame of the first, one after the other, by the images in which a board is seen by the next
    one and by one already placed, most such images first. Lenses stay as they are; images go together by their numbers.

    Raises InputError for a board without two ends, and for a camera that shares too few images with the others.
    """
    if len(cameras) > 1 and not board.has_two_ends:
        size = f"{board.columns}×{board.rows}"
        raise InputError(
            f"board: several cameras have to tell its ends apart: expected an odd and an even number of inner corners, "
            f"found {size}"
        )
    placed, steps = {0: cameras[0]}, []
    while len(placed) < len(cameras):
        pairs = [(k, near) for k in range(len(cameras)) if k not in placed for near in placed]
        common = {pair: sorted(set(seen[pair[0]].corners) & set(seen[pair[1]].corners)) for pair in pairs}
        k, near = max(pairs, key=lambda pair: len(common[pair]))
        if len(common[k, near]) < LEAST_COMMON:
            raise InputError(
                f"camera {cameras[k].name}: expected the board in {LEAST_COMMON} images where another camera has it, "
                f"found {len(common[k, near])}: do the videos start together?"
            )
        rotation, translation, errors = _stereo(cameras, seen, board, k, near, common[k, near])
        base = placed[near]
        placed[k] = replace(
            cameras[k], rotation=rotation @ base.rotation, translation=rotation @ base.translation + translation
        )
        steps.append(Joined(cameras[k].name, cameras[near].name, errors))
    return [placed[k] for k in range(len(cameras))], steps


def _stereo(
    cameras: Sequence[Camera], seen: Sequence[Sightings], board: Board, k: int, near: int, common: Sequence[int]
) -> tuple[FloatArray, FloatArray, dict[int, float]]:
    """Return the rotation (3, 3) and the translation (3,), m, from camera `near` to camera k, and errors by image."""
    points = [board.corners_m.astype(np.float32)] * len(common)
    before, after = ([seen[at].corners[number].astype(np.float32) for number in common] for at in (near, k))
    one, other = cameras[near], cameras[k]
    found: tuple[Any, ...] = cv2.stereoCalibrateExtended(
        points, before, after, one.matrix, one.distortion, other.matrix, other.distortion, seen[near].size,
        np.eye(3), np.zeros((3, 1)), flags=cv2.CALIB_FIX_INTRINSIC,
    )  # fmt: skip
    rotation, translation, errors = (np.asarray(found[k], np.float64) for k in (5, 6, -1))
    by_image = np.sqrt(np.mean(np.square(errors), axis=1))
    return rotation, translation.ravel(), dict(zip(common, by_image.tolist(), strict=True))


def on_floor(cameras: Sequence[Camera], seen: Sequence[Sightings], board: Board, number: int) -> list[Camera]:
    """Place cameras in a world whose z axis is up and whose floor the board lies on in image `number`: its first corner
    is the origin, x leads along its row. Raises InputError where no camera shows the board in that image."""
    for camera, sightings in zip(cameras, seen, strict=True):
        if number in sightings.corners:
            corners = sightings.corners[number]
            _, turn, shift = cv2.solvePnP(board.corners_m, corners, camera.matrix, camera.distortion)
            rotation = np.asarray(cv2.Rodrigues(turn)[0], np.float64) @ TO_BOARD
            return in_world(cameras, camera, rotation, np.asarray(shift, np.float64).ravel())
    raise InputError(f"floor: expected the board in image {number} of some camera, found it in none")


def level(cameras: Sequence[Camera]) -> list[Camera]:
    """Place cameras in a world with its origin in the first, taken to stand level, x ahead and z up."""
    return in_world(cameras, cameras[0], TO_LEVEL, np.zeros(3))


def in_world(cameras: Sequence[Camera], camera: Camera, rotation: FloatArray, translation: FloatArray) -> list[Camera]:
    """Move cameras to a world that is taken to one of them by a rotation (3, 3) and a translation (3,), m."""
    turn = camera.rotation.T @ rotation
    shift = camera.rotation.T @ (translation - camera.translation)
    return [
        replace(each, rotation=each.rotation @ turn, translation=each.rotation @ shift + each.translation)
        for each in cameras
    ]
