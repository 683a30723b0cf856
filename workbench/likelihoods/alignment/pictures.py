"""One camera's image as it is compared: smoothed more and less, with gradients."""

from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np
from scipy.ndimage import map_coordinates

from workbench.arrays import Float32Array, FloatArray
from workbench.likelihoods.alignment.kernels import sample
from workbench.threads import over_threads

_STEPS = np.array([[0.0, 0.0], [1.0, 0.0], [-1.0, 0.0], [0.0, 1.0], [0.0, -1.0]])[:, None]


@dataclass(frozen=True, eq=False)
class Picture:
    """(height, width) values."""

    values: Float32Array

    def at(self, pixels: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return values (K,) and gradients (K, 2), 1/px, between the centres of pixels (K, 2), which lie at least 2 px
        inside: half the differences of what is a pixel to either side. See `at_reference`."""
        values, gradients = np.empty(len(pixels)), np.empty((len(pixels), 2))
        sample(self.values, pixels, values, gradients)
        return values, gradients

    def at_reference(self, pixels: FloatArray) -> tuple[FloatArray, FloatArray]:
        """`at` in plain SciPy."""
        rows, columns = (pixels + _STEPS).reshape(-1, 2).T[::-1]
        found = map_coordinates(self.values.astype(np.float64), (rows, columns), order=1)
        here, right, left, below, above = found.reshape(5, -1)
        return here, 0.5 * np.column_stack([right - left, below - above])


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
