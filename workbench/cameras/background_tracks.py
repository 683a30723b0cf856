"""Corners of a video's background, outside of the people's outlines, tracked through its images.

They are tracked from key frames by pyramidal Lucas–Kanade (Bouguet 2001), and back.
"""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import TypeAlias

import cv2
import numpy as np

from workbench.cameras.image_changes import small_grey
from workbench.utils.arrays import BoolArray, ByteArray, FloatArray, IntArray

LONG_SIDE_PX = 480
"""Of the images that corners are tracked in."""
_CELL_PX, _MAX_CORNERS = 10, 100
"""Side of the cells with one corner each, so that a logo and people count by their area and not by their contrast; and
corners of a key frame."""
_MIN_GRADIENT = 1.0
"""Grey levels per pixel in every direction. With noise of 2 levels, a window of 15² pixels is found to 2 / 15 px."""
_WINDOW_PX, _LEVELS, _ITERATIONS, _STEP_PX = 15, 2, 10, 0.02
_MARGIN = 0.12
"""Of the hull of a person's joints, over its longer side: the top of the head lies outside of the joints by as much."""
_MAX_LOOP_PX = 0.5
"""Distance by which a corner that is tracked to another frame and back misses its place: several times the error of a
corner that is really visible, which is about 0.1 px."""
_MIN_TRACKS, _MIN_FOUND = 10, 0.25
"""Tracks of a measured frame: twice those that determine a homography; and their fraction of the corners that
should be visible. With less, most of the background is blurred, and what is found may be a logo."""
_MIN_OVERLAP = 0.6
"""Fraction of a key frame's corners in the image, below which the next key frame begins."""
STATIC_SHIFT = 1.0 / LONG_SIDE_PX
"""Motion of the background, over the image's longer side, of a camera that stands still: ten times the error of a
corner, and a fifth of that of a detected joint of a person who fills half of the image."""
BRIEF_FRAMES = 5
"""Frames with another state than those around, of which less than half is a failure of the tracks and no motion."""
PARALLAX = 0.03
"""Of its motion, by which a track may miss the rotation's: the effect of the lens distortion of phones. Points in
distances of 1 and 2 differ by half of the motion of a camera that travels."""
_STOP = cv2.TERM_CRITERIA_EPS | cv2.TERM_CRITERIA_COUNT


@dataclass(frozen=True, eq=False)
class CornerTracks:
    """Corners of the background in T frames.

    size: width and height of the images, px. keys: (T,) number of the key frame from which the frame's corners are
    tracked; its own for the first frame; -1 where too few corners are found again. start, end: (T, N, 2) positions in
    the key frame and in the frame, px; NaN for none, as in frames between two others in which the camera stands still.
    consistent: (T, N) inliers of the pair's homography.
    """

    size: tuple[int, int]
    keys: IntArray
    start: FloatArray
    end: FloatArray
    consistent: BoolArray

    @property
    def lost(self) -> float:
        """Return the fraction of frames without a measured background."""
        return float((self.keys < 0).mean())

    @property
    def shifts(self) -> FloatArray:
        """Return the distances (T, N) from the key frame, over the image's longer side; NaN without a track."""
        return np.asarray(np.linalg.norm(self.end - self.start, axis=2) / max(self.size))


def stands(shifts: FloatArray, consistent: BoolArray) -> BoolArray:
    """Return in which frames (...) more tracks stand still than move together, from their shifts (..., N) over the
    image's longer side, and which (..., N) fit one homography."""
    standing = shifts < STATIC_SHIFT
    return np.asarray(standing.sum(axis=-1) >= (consistent & ~standing).sum(axis=-1))


def track_background(images: Iterable[ByteArray], people: Sequence[FloatArray]) -> CornerTracks:
    """Track corners of the background through the T images of a video; while it stands still, to every fifth one.

    Parameters
    ----------
    images : (height, width, 3) RGB or (height, width) grey.
    people : (n, J, 2 or more) joints of all people in each image, px; NaN for joints that are not seen.
    """
    size, keys, pairs = (1, 1), list[int](), list[_Pair | None]()
    first: _Picture | None = None
    key: _Picture | None = None
    last: _Picture | None = None
    overlaid = np.empty((0, 2))
    rests = 0  # frames until the next one is measured, while the camera stands still
    for t, (image, joints) in enumerate(zip(images, people, strict=False)):
        size = image.shape[1], image.shape[0]
        if rests and key is not None:
            rests -= 1
            pairs.append(None)
            keys.append(key.number)
            continue
        picture = _Picture.of(t, image, joints, overlaid)
        pair, used = None, None
        for used in dict.fromkeys(each for each in (key, last, first) if each is not None):
            if (pair := used.follow(picture)) is not None:
                break
        pairs.append(pair)
        keys.append(-1 if pair is None and t else t if used is None else used.number)
        if pair is None and t:
            continue  # the key frame's corners may become visible again
        if pair is not None:
            overlaid = np.unique(np.concatenate([overlaid, _overlaid(*pair)]), axis=0)
            shifts = np.linalg.norm(pair[1] - pair[0], axis=1) / max(size)
            rests = BRIEF_FRAMES - 1 if stands(shifts, pair[2]) else 0
        first, last = first or picture, picture
        key = picture if used is None or used.visible < _MIN_OVERLAP else used
    return _tracks(size, keys, pairs)


_Pair: TypeAlias = tuple[FloatArray, FloatArray, BoolArray]
"""Positions (n, 2), px, of corners in the key frame and in another frame, and which (n,) fit one homography."""


class _Picture:
    """A small grey image of the frame `number`, and its corners once they are followed."""

    def __init__(self, number: int, grey: ByteArray, background: ByteArray, factor: float) -> None:
        self.number, self.grey, self.background, self.factor = number, grey, background, factor
        self.visible = 1.0
        self._corners: FloatArray | None = None
        self._shifts = np.empty((0, 2))

    @staticmethod
    def of(number: int, image: ByteArray, joints: FloatArray, overlaid: FloatArray) -> "_Picture":
        """Return the small picture of an image; its background excludes people with joints (n, J, 2 or more) and
        overlaid places (m, 2), px."""
        factor = min(LONG_SIDE_PX / max(image.shape[:2]), 1.0)
        grey = small_grey(image, LONG_SIDE_PX)
        background = _background(grey.shape, joints * factor)
        for place in (overlaid * factor).round().astype(int):
            cv2.circle(background, (int(place[0]), int(place[1])), _CELL_PX, 0, -1)
        return _Picture(number, grey, background, factor)

    @property
    def corners(self) -> FloatArray:
        """The corners (n, 2) of the background, px."""
        if self._corners is None:
            self._corners = _corners(self.grey, self.background)
            self._shifts = np.zeros(self._corners.shape)
        return self._corners

    def follow(self, other: "_Picture") -> _Pair | None:
        """Return the corners that are found in another image and back, in px of the source; None for too few."""
        start = self.corners
        if len(start) < _MIN_TRACKS:
            return None
        height, width = other.grey.shape
        end, found = _flow(self.grey, other.grey, start, start + self._shifts)
        shift = np.median((end - start)[found], axis=0) if found.any() else np.zeros(2)
        back, found_back = _flow(other.grey, self.grey, end, end - shift)
        inside = np.asarray(((end >= 0.0) & (end <= [width - 1, height - 1])).all(axis=1))
        column, row = np.where(inside[:, None], end, 0.0).round().astype(int).T
        closed = np.linalg.norm(back - start, axis=1) < _MAX_LOOP_PX
        valid = found & found_back & closed & inside & (other.background[row, column] > 0)
        if valid.sum() < _MIN_TRACKS:
            return None
        homography, consistent = _homography(start[valid], end[valid])
        if homography is None:
            return None
        predicted = cv2.perspectiveTransform(start[:, None].astype(np.float64), homography)[:, 0]
        in_image = np.asarray(((predicted >= 0.0) & (predicted <= [width - 1, height - 1])).all(axis=1))
        column, row = predicted[in_image].round().astype(int).T
        if valid.sum() < _MIN_FOUND * (other.background[row, column] > 0).sum():
            return None
        self._shifts = np.where(valid[:, None], end, predicted) - start
        self.visible = float(in_image.mean())
        ends = [(np.asarray(each[valid], np.float64) + 0.5) / self.factor - 0.5 for each in (start, end)]
        return ends[0], ends[1], consistent


def _corners(grey: ByteArray, background: ByteArray) -> FloatArray:
    """Return the strongest corner (n, 2), px, of every cell of a grey image that has one in the background."""
    rows, columns = grey.shape[0] // _CELL_PX, grey.shape[1] // _CELL_PX
    strength = np.where(background > 0, cv2.cornerMinEigenVal(grey, 5), 0.0)[: rows * _CELL_PX, : columns * _CELL_PX]
    cells = strength.reshape(rows, _CELL_PX, columns, _CELL_PX).swapaxes(1, 2).reshape(rows * columns, _CELL_PX**2)
    if not len(cells):
        return np.empty((0, 2))
    inside, place = np.divmod(cells.argmax(axis=1), _CELL_PX), np.divmod(np.arange(rows * columns), columns)
    positions = np.stack([place[1] * _CELL_PX + inside[1], place[0] * _CELL_PX + inside[0]], axis=1)
    positions = positions[cells.max(axis=1) > (2.0 * _MIN_GRADIENT / 255.0) ** 2]  # the scale of OpenCV's eigenvalues
    return positions[np.linspace(0, len(positions) - 1, min(len(positions), _MAX_CORNERS)).round().astype(int)]


def _homography(start: FloatArray, end: FloatArray) -> tuple[FloatArray | None, BoolArray]:
    """Return the homography (3, 3) that most of the tracks (n, 2) follow, None without one, and which ones (n,) do.

    Where most tracks move, those that stand still are on the image and not in the scene, such as logos and subtitles.
    OpenCV's RANSAC begins every call with the same random numbers.
    """
    shifts, consistent = np.linalg.norm(end - start, axis=1), np.zeros(len(start), bool)
    moved = (shifts >= 0.5) | (float(np.median(shifts)) < 1.0)
    if moved.sum() < _MIN_TRACKS:
        return None, consistent
    tolerance_px = max(1.0, PARALLAX * float(np.median(shifts)))
    homography, inliers = cv2.findHomography(start[moved], end[moved], cv2.RANSAC, tolerance_px, maxIters=300)
    if homography is not None:
        consistent[np.flatnonzero(moved)] = inliers[:, 0] > 0
    return homography, consistent


def _overlaid(start: FloatArray, end: FloatArray, consistent: BoolArray) -> FloatArray:
    """Return the places (m, 2), px, that stand still in the image while the background moves clearly."""
    shifts = np.linalg.norm(end - start, axis=1)
    moves = consistent.any() and float(np.median(shifts[consistent])) > _CELL_PX
    return start[(shifts < 1.0) & ~consistent] if moves else start[:0]


def _background(shape: tuple[int, ...], people: FloatArray) -> ByteArray:
    """Return the mask (height, width), 255 outside of the people with joints (n, J, 2 or more), px."""
    mask = np.full(shape, 255, np.uint8)
    for joints in people:
        seen = joints[np.isfinite(joints[:, 0]), :2].astype(np.float32)
        if len(seen):
            hull = cv2.convexHull(seen).round().astype(np.int32)
            margin = _MARGIN * float(np.ptp(seen, axis=0).max())
            cv2.fillConvexPoly(mask, hull, 0)
            cv2.polylines(mask, [hull], True, 0, 2 * round(margin) + 1)
    return mask


def _flow(before: ByteArray, after: ByteArray, start: FloatArray, guess: FloatArray) -> tuple[FloatArray, BoolArray]:
    """Return the places (n, 2) of points in the image after, and which are found, from a guess."""
    places, status, _ = cv2.calcOpticalFlowPyrLK(
        before, after, start.astype(np.float32), guess.astype(np.float32), winSize=(_WINDOW_PX, _WINDOW_PX),
        maxLevel=_LEVELS, flags=cv2.OPTFLOW_USE_INITIAL_FLOW, criteria=(_STOP, _ITERATIONS, _STEP_PX),
    )  # fmt: skip
    return np.asarray(places), np.asarray(status[:, 0] > 0)


def _tracks(size: tuple[int, int], keys: Sequence[int], pairs: Sequence[_Pair | None]) -> CornerTracks:
    """Return the tracks of images of a size (width, height), px, from the key frames and the pairs of all frames."""
    n = max([_MIN_TRACKS, *(len(pair[0]) for pair in pairs if pair is not None)])
    start, end = (np.full((len(pairs), n, 2), np.nan) for _ in range(2))
    consistent = np.zeros((len(pairs), n), bool)
    for t, pair in enumerate(pairs):
        if pair is not None:
            start[t, : len(pair[0])], end[t, : len(pair[1])], consistent[t, : len(pair[2])] = pair
    return CornerTracks(size, np.array(keys, dtype=np.int64), start, end, consistent)
