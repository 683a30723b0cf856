"""One camera's image as it is compared: smoothed more and less, with gradients."""

from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np

from workbench.likelihoods.dense.kernels import sample
from workbench.utils.arrays import Float32Array, FloatArray
from workbench.utils.parallel import over_threads


@dataclass(frozen=True, eq=False)
class Picture:
    """(height, width) values."""

    values: Float32Array

    def at(self, pixels: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return values (K,) and gradients (K, 2), 1/px, between the centres of pixels (K, 2), which lie at least 2 px
        inside: half the differences of what is a pixel to either side."""
        values, gradients = np.empty(len(pixels)), np.empty((len(pixels), 2))
        sample(self.values, pixels, values, gradients)
        return values, gradients


def picture(image: Float32Array, blur_px: float) -> Picture:
    """Smooth an image (height, width)."""
    return Picture(np.asarray(cv2.GaussianBlur(image, (0, 0), blur_px), dtype=np.float32))


def pictures(images: Sequence[Float32Array], blurs_px: Sequence[float]) -> list[tuple[Picture, ...]]:
    """Return every image at every smoothing."""
    wanted = [(image, blur) for image in images for blur in blurs_px]
    found: dict[int, Picture] = {}

    def smooth(first: int, last: int) -> None:
        found.update({k: picture(*wanted[k]) for k in range(first, last)})

    over_threads(smooth, len(wanted), 1)
    return [tuple(found[k * len(blurs_px) + level] for level in range(len(blurs_px))) for k in range(len(images))]
