"""Something that passes between the camera and the person: a board that somebody carries by."""

from dataclasses import dataclass

import numpy as np

from workbench.datasets.rendering.render import background
from workbench.utils.arrays import FloatArray, IntArray

WIDTH, HEIGHT = (0.15, 0.3), (0.5, 1.1)
"""Of the board, drawn between these, in parts of the person's height in the image."""
SPEED = (0.03, 0.06)
"""At which it passes the person, a frame at 30 Hz, in the same parts."""
PASSES = (0.35, 0.65)
"""When it is in front of their middle, in parts of the clip."""
_RATE_HZ = 30.0


@dataclass(frozen=True, eq=False)
class Board:
    """An upright rectangle with a pattern. picture: (h, w) grey levels. corners: (F, 2), whole px, the row and column
    of its upper left corner in each frame, which may lie outside the image."""

    picture: FloatArray
    corners: IntArray

    def cover(self, image: FloatArray, frame: int) -> FloatArray:
        """Return the image (height, width) with what of the board is in it in a frame drawn over it."""
        top, left = self.corners[frame]
        height, width = self.picture.shape
        rows = np.arange(max(top, 0), min(top + height, image.shape[0]))
        columns = np.arange(max(left, 0), min(left + width, image.shape[1]))
        covered = image.copy()
        covered[np.ix_(rows, columns)] = self.picture[np.ix_(rows - top, columns - left)]
        return covered


def passing_board(pixels: FloatArray, rate_hz: float, rng: np.random.Generator) -> Board:
    """Draw a board that passes once in front of a person whose joints are at pixels (F, J, 2), from either side.

    It keeps its pace beside the person, so that it passes whoever walks with or against it: before and after its
    passage it is beside them. It reaches from below the person upwards, and may hide the head or leave it free.
    """
    low, high = pixels.min(axis=1), pixels.max(axis=1)
    tall = float(np.median(high[:, 1] - low[:, 1]))
    width, height = (max(1, round(tall * rng.uniform(*span))) for span in (WIDTH, HEIGHT))
    side, pace = rng.choice([-1.0, 1.0]), tall * rng.uniform(*SPEED) * _RATE_HZ / rate_hz
    passing = rng.uniform(*PASSES) * (len(pixels) - 1)
    middle = 0.5 * (low[:, 0] + high[:, 0]) + side * pace * (np.arange(len(pixels)) - passing)
    bottom = np.full(len(pixels), np.median(high[:, 1]) + 0.05 * tall)
    corners = np.stack([bottom - height, middle - 0.5 * width], axis=1).round().astype(np.int64)
    return Board(background(height, width, rng), corners)
