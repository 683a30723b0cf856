"""Cuts of a video, where another camera or another time follows at once, and images that repeat the one before."""

from itertools import pairwise

import cv2
import numpy as np

from workbench.utils.arrays import BoolArray, ByteArray, FloatArray, IntArray

_SIDE_PX = 48
"""Longer side of the thumbnails that are compared. People's limbs are about a pixel wide there, rooms many."""
_SAMPLES = 5
"""Along each side of a thumbnail's pixel, so that large images take no longer than small ones."""
_DETAIL_PX = 9
"""Width of the mean that is subtracted, so that a bright sky over dark ground makes no two images alike."""
_MIN_CONTRAST = 1.0
"""Standard deviation, grey levels, of a thumbnail's details: four times that of rounding. Images with less are uniform,
as in a flash or a fade, and are not compared."""
_UNLIKE, _ALIKE = 0.3, 0.5
"""Correlations of details. Those of unrelated images have a standard deviation of 0.06, as a thumbnail has some 300
independent details: _UNLIKE is five of them. Above _ALIKE neighbouring images share more than they differ by."""
_WINDOW_S, _MIN_WINDOW = 0.5, 3
"""Time before and after a cut in which all images are compared, and the least number of them: a flash, and a person who
passes right in front of the camera, are over within half a second."""
_MATCHED_PX, _N_CORNERS, _TOLERANCE_PX = 480, 500, 3.0
_MIN_CORNERS, _MIN_FOUND_AGAIN = 12, 0.125
"""Corners, and their fraction of those that should be visible, that must be found again in the other image at places of
one homography: chance finds up to 9; a logo, and a person shown by two cameras, cover less than an eighth of most
images."""
_SAME_LEVELS, _SAME_RATIO = 0.1, 0.05
"""Mean difference from the image before, grey levels, below which an image repeats it, and its ratio to that of moving
images: twenty times less than by the noise of a camera and a person's motion, and less than by coding."""
_MAX_REDRAWN, _REDRAWN_LEVELS = 5, 2
"""Images that an encoder takes to draw a picture again, and the largest difference of its thumbnails, grey levels: that
of the coding, and of rounding twice. A hand that moves by its width changes a pixel of a thumbnail by a tenth of its
contrast or more."""
_FROZEN_S, _MIN_FROZEN = 0.25, 3
"""Shortest time for which a video is frozen, half a step of a walk, and the least number of repeated images."""


class ImageChanges:
    """How each image of a video differs from those before; the images are added in order."""

    def __init__(self) -> None:
        self._differences = list[float]()
        self._thumbnails = list[ByteArray]()
        self._numbers = list[int]()  # of the images with contrast
        self._candidates = list[int]()  # rows of them that are unlike the row before, without its corners
        self._before: ByteArray | None = None
        self._last: tuple[ByteArray, FloatArray] | None = None  # the latest image with contrast, and its details

    def add(self, image: ByteArray) -> None:
        """Add the next image (height, width, 3), RGB or BGR."""
        factor = _SIDE_PX / max(image.shape[:2])
        width, height = (max(round(factor * side), 1) for side in image.shape[1::-1])
        sampled = cv2.resize(image, (_SAMPLES * width, _SAMPLES * height), interpolation=cv2.INTER_NEAREST)
        grey = np.asarray(cv2.cvtColor(sampled, cv2.COLOR_RGB2GRAY), np.uint8)
        before, self._before = self._before, grey
        if before is None or before.shape != grey.shape:
            self._differences.append(np.inf)
        else:
            self._differences.append(float(cv2.absdiff(grey, before).mean()))
        self._thumbnails.append(np.asarray(cv2.resize(grey, (width, height), interpolation=cv2.INTER_AREA), np.uint8))
        if (details := _details(self._thumbnails[-1])) is None:
            return
        unlike = self._last is not None and _correlation(self._last[1], details) < _UNLIKE
        if unlike and self._last is not None and not _is_found_again(self._last[0], image):
            self._candidates.append(len(self._numbers))
        self._last = image, details
        self._numbers.append(len(self._thumbnails) - 1)

    def cuts(self, rate_hz: float) -> IntArray:
        """Return the numbers of the images that begin another part of the video, increasing.

        All images before a cut, for _WINDOW_S, are unlike all images after it, while most neighbours on either side are
        alike: neither a flash or a person who hides everything for a moment, after which the same images return, nor a
        fast pan, in which all neighbours differ. A slow dissolve is not found.
        """
        window = max(round(_WINDOW_S * rate_hz), _MIN_WINDOW)
        return np.array([self._numbers[k] for k in self._candidates if self._is_cut(k, window)], dtype=np.intp)

    def _is_cut(self, k: int, window: int) -> bool:
        sides = (self._numbers[max(k - window, 0) : k], self._numbers[k : k + window])
        details = [[_details(self._thumbnails[number]) for number in side] for side in sides]
        before, after = ([each for each in side if each is not None] for side in details)
        unlike = all(_correlation(one, other) < _UNLIKE for one in before for other in after)
        return unlike and _are_alike(before) and _are_alike(after)

    def repeated(self) -> BoolArray:
        """Return which images (F,) repeat the one before, in a video that moves otherwise.

        Between two stretches of repeated images, up to _MAX_REDRAWN others repeat them, too, if the picture is the same
        after as before: there the encoder draws it again, and sharpens it.
        """
        differences = np.array(self._differences)
        moving = differences[np.isfinite(differences) & (differences >= _SAME_LEVELS)]
        limit = min(_SAME_LEVELS, _SAME_RATIO * float(np.median(moving))) if len(moving) else 0.0
        repeated = np.asarray(differences < limit)
        for before, after in pairwise(np.flatnonzero(repeated).tolist()):
            if 1 < after - before <= _MAX_REDRAWN + 1 and self._is_same_picture(before, after):
                repeated[before:after] = True
        return repeated

    def _is_same_picture(self, number: int, other: int) -> bool:
        """Return whether two images differ only in what coding adds, which thumbnails hardly show."""
        one, another = self._thumbnails[number], self._thumbnails[other]
        return one.shape == another.shape and int(cv2.absdiff(one, another).max()) <= _REDRAWN_LEVELS


def frozen(repeated: BoolArray, rate_hz: float) -> BoolArray:
    """Return which images (F,) belong to stretches of _FROZEN_S or more in which all repeat the one before."""
    edges = np.flatnonzero(np.diff(np.concatenate([[False], repeated, [False]]).astype(np.int8)))
    stretches = np.zeros(len(repeated), bool)
    for first, end in zip(edges[::2], edges[1::2], strict=True):
        stretches[first:end] = end - first >= max(_FROZEN_S * rate_hz, _MIN_FROZEN)
    return stretches


def small_grey(image: ByteArray, longest_px: int) -> ByteArray:
    """Return an RGB or grey image in grey, with a longer side of at most `longest_px`."""
    factor = min(longest_px / max(image.shape[:2]), 1.0)
    small = cv2.resize(image, None, fx=factor, fy=factor, interpolation=cv2.INTER_AREA) if factor < 1.0 else image
    return np.asarray(small if small.ndim == 2 else cv2.cvtColor(small, cv2.COLOR_RGB2GRAY), np.uint8)


def _details(thumbnail: ByteArray) -> FloatArray | None:
    """Return the details (n,) of a thumbnail, of mean 0 and norm 1; None without contrast."""
    details = thumbnail.astype(np.float64)
    details = (details - cv2.blur(details, (_DETAIL_PX, _DETAIL_PX))).ravel()
    details -= details.mean()
    if details.std() < _MIN_CONTRAST:
        return None
    return np.asarray(details / np.linalg.norm(details))


def _correlation(one: FloatArray, other: FloatArray) -> float:
    return float(one @ other) if len(one) == len(other) else -1.0


def _are_alike(details: list[FloatArray]) -> bool:
    """Return whether most neighbours of successive images are alike."""
    each = [_correlation(one, other) for one, other in pairwise(details)]
    return bool(each) and float(np.median(each)) > _ALIKE


def _is_found_again(before: ByteArray, after: ByteArray) -> bool:
    """Return whether corners of an image are found again in another one, at places of one homography."""
    before, after = (small_grey(each, _MATCHED_PX) for each in (before, after))
    detector = cv2.ORB.create(_N_CORNERS)
    (corners, words), (places, other_words) = (detector.detectAndCompute(each, None) for each in (before, after))
    if words is None or other_words is None:
        return False
    matches = cv2.BFMatcher(cv2.NORM_HAMMING, crossCheck=True).match(words, other_words)
    if len(matches) < _MIN_CORNERS:
        return False
    start = np.array([corners[each.queryIdx].pt for each in matches])
    end = np.array([places[each.trainIdx].pt for each in matches])
    homography, inliers = cv2.findHomography(start, end, cv2.RANSAC, _TOLERANCE_PX)
    if homography is None:
        return False
    every = np.array([corner.pt for corner in corners])
    moved = cv2.perspectiveTransform(every[:, None], homography)[:, 0]
    visible = ((moved >= 0.0) & (moved < after.shape[1::-1])).all(axis=1).sum()
    return int(inliers.sum()) >= max(_MIN_CORNERS, _MIN_FOUND_AGAIN * int(visible))
