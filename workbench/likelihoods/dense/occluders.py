"""What passes in front of the person: found where it is beside them, and followed over them."""

from dataclasses import dataclass

import cv2
import numpy as np

from workbench.likelihoods.dense.background_model import grown
from workbench.utils.arrays import BoolArray, Float32Array, IntArray

LEAST_PX = 400
"""Pixels of what counts as something of its own when it is first seen."""
OFF_PX = 15
"""So far from the outline expected something may still be the person."""
FARTHEST_PX = 24
"""How far it may go to either side from frame to frame; upwards and downwards it goes RISES_PX."""
RISES_PX = 3
WORST = 25.0
"""Mean difference, grey levels, at which it is no longer found."""
_CLIPPED = 40.0
_LEAST_LEFT, _COMPARED = 50, 1000  # pixels, at least that must be left and at most that are compared


@dataclass(frozen=True, eq=False)
class Passing:
    """What was seen to pass: its pixels (height, width) in the last image, and that image, a little smoothed."""

    mask: BoolArray
    image: Float32Array

    def followed(self, image: Float32Array, foreground: BoolArray, person: BoolArray, unknown: BoolArray) -> "Passing":
        """Find it in the next image, and what is new beside the person.

        It moves as one piece; where it enters the image, or was hidden in part, foreground that touches it joins it,
        but none within OFF_PX of the person (height, width). Foreground that is new, has LEAST_PX and touches neither
        the person nor what is unknown begins to pass.
        """
        smooth = np.asarray(cv2.GaussianBlur(image, (0, 0), 1.0), dtype=np.float32)
        mask = _shifted(self.mask, _shift(self.image, self.mask, smooth))
        whole = cleaned(foreground)
        off = ~grown(person, 2 * OFF_PX + 1)
        _, pieces, boxes, _ = cv2.connectedComponentsWithStats((whole & off).astype(np.uint8))
        _, joined = cv2.connectedComponents((whole | unknown).astype(np.uint8))
        persons = np.unique(joined[grown(person, 9) | unknown])
        sizes = boxes[:, cv2.CC_STAT_AREA]
        taken = np.bincount(pieces[mask], minlength=len(sizes)) > 0  # by a piece's number, of which 0 is none
        for k in np.flatnonzero(sizes[1:] > LEAST_PX) + 1:
            taken[k] |= joined.ravel()[np.argmax(pieces.ravel() == k)] not in persons  # the same all over a piece
        taken[0] = False
        if taken.any():
            mask = mask | taken[pieces]
        return Passing(mask, smooth)


def nothing_passing(image: Float32Array) -> Passing:
    """Begin with an image."""
    return Passing(np.zeros(image.shape, np.bool_), np.asarray(cv2.GaussianBlur(image, (0, 0), 1.0), dtype=np.float32))


def cleaned(mask: BoolArray) -> BoolArray:
    """Drop single pixels and close small holes."""
    opened = cv2.morphologyEx(mask.astype(np.uint8), cv2.MORPH_OPEN, np.ones((3, 3), np.uint8))
    return np.asarray(cv2.morphologyEx(opened, cv2.MORPH_CLOSE, np.ones((5, 5), np.uint8)) > 0)


def _shift(before: Float32Array, mask: BoolArray, image: Float32Array) -> tuple[int, int] | None:
    """How many rows and columns the masked part of an image has moved by in the next; None where it is not there."""
    rows, columns = np.nonzero(mask)
    if len(rows) < _LEAST_LEFT:
        return None
    rows, columns = (each[:: -(-len(rows) // _COMPARED)] for each in (rows, columns))
    levels = before[rows, columns]

    def difference(way: tuple[int, int]) -> float:
        y, x, in_image = _moved(rows, columns, way, mask.shape)
        if in_image.sum() < _LEAST_LEFT:
            return float(np.inf)
        return float(np.minimum(np.abs(image[y, x] - levels[in_image]), _CLIPPED).mean())

    coarse = [(dy, dx) for dx in range(-FARTHEST_PX, FARTHEST_PX + 1, 2) for dy in range(-RISES_PX, RISES_PX + 1, 3)]
    best = min(coarse, key=difference)
    best = min(((best[0] + dy, best[1] + dx) for dx in (-1, 0, 1) for dy in (-1, 0, 1)), key=difference)
    return best if difference(best) < WORST else None


def _shifted(mask: BoolArray, way: tuple[int, int] | None) -> BoolArray:
    shifted = np.zeros_like(mask)
    if way is not None:
        rows, columns = np.nonzero(mask)
        y, x, _ = _moved(rows, columns, way, mask.shape)
        shifted[y, x] = True
    return shifted


def _moved(
    rows: IntArray, columns: IntArray, way: tuple[int, int], shape: tuple[int, ...]
) -> tuple[IntArray, IntArray, BoolArray]:
    """Rows and columns after a shift, of those that stay in the image, and which (K,) these are."""
    y, x = rows + way[0], columns + way[1]
    in_image = (y >= 0) & (x >= 0) & (y < shape[0]) & (x < shape[1])
    return y[in_image], x[in_image], in_image
