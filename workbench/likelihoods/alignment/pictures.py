"""One camera's image as it is compared: smoothed more and less, with gradients."""

from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np

from workbench.arrays import Float32Array, FloatArray

_HALF = np.array([[-0.5, 0.0, 0.5]], dtype=np.float32)


@dataclass(frozen=True, eq=False)
class Picture:
    """(height, width) values and their derivatives by column and row, 1/px."""

    values: Float32Array
    by_x: Float32Array
    by_y: Float32Array

    def at(self, pixels: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return values (K,) and gradients (K, 2) between the centres of pixels (K, 2)."""
        return sampled(self.values, pixels), np.column_stack([sampled(g, pixels) for g in (self.by_x, self.by_y)])


def picture(image: Float32Array, blur_px: float) -> Picture:
    """Smooth an image (height, width) and differentiate it."""
    smooth = np.asarray(cv2.GaussianBlur(image, (0, 0), blur_px), dtype=np.float32)
    by_x, by_y = cv2.filter2D(smooth, -1, _HALF), cv2.filter2D(smooth, -1, _HALF.T)
    return Picture(smooth, np.asarray(by_x, dtype=np.float32), np.asarray(by_y, dtype=np.float32))


def pictures(image: Float32Array, blurs_px: Sequence[float]) -> tuple[Picture, ...]:
    """Return an image at every smoothing."""
    return tuple(picture(image, blur) for blur in blurs_px)


def sampled(image: Float32Array, pixels: FloatArray) -> FloatArray:
    """Return values (K,) of an image between the centres of pixels (K, 2), which lie inside."""
    if not len(pixels):
        return np.zeros(0)
    x, y = np.ascontiguousarray(pixels.T, dtype=np.float32)
    return np.asarray(cv2.remap(image, x[None], y[None], cv2.INTER_LINEAR)[0], dtype=np.float64)
