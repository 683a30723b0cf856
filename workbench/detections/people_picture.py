"""A picture of the people in a video, each in one frame, with the numbers by which a target is chosen."""

from collections.abc import Mapping
from pathlib import Path

import cv2
import numpy as np

from workbench.detections.association.detector_view import prominence
from workbench.detections.association.target_selection import TrackedPeople
from workbench.utils.arrays import ByteArray, FloatArray
from workbench.utils.atomic_write import whole_file
from workbench.utils.decode import decode

NAME = "people.png"
"""Name of the picture in a folder of a run or of detections."""
_TILE_PX, _COLUMNS, _MAX_PEOPLE = (180, 270), 8, 64
"""Width and height of one person's picture, people in a row, and people drawn, the most prominent ones."""
_MARGIN = 0.15
"""Margin around the joints, in heights: head and feet extend beyond their joints by a tenth."""
_WHITE, _BLACK = (255, 255, 255), (0, 0, 0)


def write_people(path: Path, video: Path, tracked: TrackedPeople) -> None:
    """Write a picture of the people in one view, in order of their numbers, each in the frame that shows them best.

    Parameters
    ----------
    path : PNG file.
    video : file or folder of images in which the people are detected.
    tracked : the people.
    """
    best = {number: _best_frame(tracked.of(number)[0]) for number in tracked.numbers}
    drawn = sorted(sorted(best, key=lambda number: -best[number][1])[:_MAX_PEOPLE])
    wanted = {
        number: (int(tracked.frames[best[number][0]]), tracked.of(number)[0][best[number][0]]) for number in drawn
    }
    tiles = _tiles(video, wanted)
    blank = np.zeros((_TILE_PX[1], _TILE_PX[0], 3), np.uint8)
    rows = [drawn[k : k + _COLUMNS] for k in range(0, len(drawn), _COLUMNS)]
    width = min(_COLUMNS, len(drawn))
    picture = np.vstack([np.hstack([tiles.get(k, blank) for k in [*row, *[-1] * (width - len(row))]]) for row in rows])
    with whole_file(path) as part:
        part.write_bytes(cv2.imencode(".png", picture[..., ::-1])[1].tobytes())


def _best_frame(joints: FloatArray) -> tuple[int, float]:
    """Return the index of the frame in which a person's joints (T, J, 3) are most prominent, and the prominence."""
    each = prominence(joints[..., :3])
    return int(np.argmax(each)), float(each.max())


def _tiles(video: Path, wanted: Mapping[int, tuple[int, FloatArray]]) -> dict[int, ByteArray]:
    """Return pictures of people by number, from the frames and joints (J, 3) that are wanted."""
    frames = [frame for frame, _ in wanted.values()]
    tiles = dict[int, ByteArray]()
    chosen = sorted(set(frames))
    for index, image in zip(chosen, decode(video, chosen[0], chosen[-1], chosen), strict=True):
        tiles |= {number: _tile(image, joints, number) for number, (frame, joints) in wanted.items() if frame == index}
    return tiles


def _tile(image: ByteArray, joints: FloatArray, number: int) -> ByteArray:
    """Return the part of an image around a person's joints (J, 3), with the number."""
    pixels = joints[np.isfinite(joints[:, 0]), :2]
    low, high = pixels.min(axis=0), pixels.max(axis=0)
    width, height = _TILE_PX
    side = (1.0 + 2.0 * _MARGIN) * max(float((high - low)[1]), float((high - low)[0]) * height / width, 1.0)
    scale, centre = height / side, 0.5 * (low + high)
    place = np.array([[scale, 0.0, 0.5 * width - scale * centre[0]], [0.0, scale, 0.5 * height - scale * centre[1]]])
    tile = cv2.warpAffine(image, place, _TILE_PX, flags=cv2.INTER_LINEAR)
    for colour, thickness in ((_BLACK, 7), (_WHITE, 2)):
        cv2.putText(tile, str(number), (6, 36), cv2.FONT_HERSHEY_SIMPLEX, 1.2, colour, thickness, cv2.LINE_AA)
    return np.asarray(tile, np.uint8)
