"""Responses of edge and ridge filters over a whole image, on a GPU: a thread a pixel.

What `edges.filters` computes of the part that is looked at, in float32; sums round otherwise than OpenCV's.
It takes the whole image, and not the part about the person alone: where that is, the GPU finds later.
"""

import math
from functools import lru_cache
from typing import Any

import cv2
import numba.cuda
import numpy as np

from workbench.arrays import Float32Array
from workbench.likelihoods.edges.filters import (
    CONTRAST_FLOOR,
    CONTRAST_WINDOW_PX,
    EDGE_SCALE_PX,
    RIDGE_SCALES_PX,
)
from workbench.likelihoods.gpu.places import HALF, ZERO, device

cuda: Any = numba.cuda
_f32: Any = np.float32
_SCALES = (EDGE_SCALE_PX, *RIDGE_SCALES_PX)
_FLOOR = _f32(CONTRAST_FLOOR)
_BLOCK = (32, 8)


def filtered_on_gpu(grey: Float32Array) -> tuple[Any, Any]:
    """The gradient (height · width · 2) and the ridges (S · height · width · 3) of an image (height, width) of grey
    levels, on the GPU; see `Filtered`."""
    height, width = grey.shape
    blocks = -(-width // _BLOCK[0]), -(-height // _BLOCK[1])
    image = cuda.to_device(np.ascontiguousarray(grey, dtype=np.float32))
    half_way, levels = cuda.device_array((height, width, 2), np.float32), _levels(height, width)
    gradient = cuda.device_array(2 * height * width, np.float32)
    ridges = cuda.device_array(len(RIDGE_SCALES_PX) * 3 * height * width, np.float32)
    *windows, squares = _constants()
    for k, weights in enumerate(windows):
        across[blocks, _BLOCK](image, weights, half_way)
        down[blocks, _BLOCK](half_way, weights, levels[k])
    differentiate[blocks, _BLOCK](levels, squares, gradient, ridges)
    return gradient, ridges


@lru_cache(maxsize=1)
def _levels(height: int, width: int) -> Any:
    """What smoothed images are written to: the image and its square at every scale, and in the contrast's window."""
    return cuda.device_array((len(_SCALES) + 1, height, width, 2), np.float32)


@lru_cache(maxsize=1)
def _constants() -> list[Any]:
    """Weights of every scale's Gaussian, cut off as OpenCV does, and of the contrast's window; the squares of the
    ridges' scales."""
    gaussians = [cv2.getGaussianKernel(int(np.rint(8.0 * sigma + 1.0)) | 1, sigma)[:, 0] for sigma in _SCALES]
    squares = np.square(np.array(RIDGE_SCALES_PX))
    window = np.full(CONTRAST_WINDOW_PX, 1.0 / CONTRAST_WINDOW_PX)
    return [cuda.to_device(each.astype(np.float32)) for each in (*gaussians, window, squares)]


@cuda.jit(fastmath=True)
def across(image: Any, weights: Any, out: Any) -> None:
    """Means (height, width, 2), along the rows, of an image and of its square."""
    x, y = cuda.grid(2)
    height, width = image.shape
    if x < width and y < height:
        total, squares = ZERO, ZERO
        for k in range(weights.shape[0]):
            level = image[y, _mirrored(x + k - weights.shape[0] // 2, width)]
            total += weights[k] * level
            squares += weights[k] * level * level
        out[y, x, 0], out[y, x, 1] = total, squares


@cuda.jit(fastmath=True)
def down(images: Any, weights: Any, out: Any) -> None:
    """Means (height, width, 2), along the columns, of two images."""
    x, y = cuda.grid(2)
    height, width, _ = images.shape
    if x < width and y < height:
        total, squares = ZERO, ZERO
        for k in range(weights.shape[0]):
            row = _mirrored(y + k - weights.shape[0] // 2, height)
            total += weights[k] * images[row, x, 0]
            squares += weights[k] * images[row, x, 1]
        out[y, x, 0], out[y, x, 1] = total, squares


@cuda.jit
def differentiate(levels: Any, squares: Any, gradient: Any, ridges: Any) -> None:
    """Write what `filters.filtered` gives of the smoothed images (1 + S + 1, height, width, 2). squares: (S,), of the
    ridges' scales."""
    x, y = cuda.grid(2)
    n, height, width, _ = levels.shape
    if x < width and y < height:
        mean, square = levels[n - 1, y, x, 0], levels[n - 1, y, x, 1]
        per = math.sqrt(max(square - mean * mean, ZERO)) + _FLOOR
        place = y * width + x
        gradient[2 * place] = _slope(levels[0], x, y, 1, 0) / per
        gradient[2 * place + 1] = _slope(levels[0], x, y, 0, 1) / per
        for s in range(n - 2):
            level, first = levels[1 + s], 3 * (s * height * width + place)
            left, right = _mirrored(x - 1, width), _mirrored(x + 1, width)
            up, below = _mirrored(y - 1, height), _mirrored(y + 1, height)
            xx = HALF * (_slope(level, right, y, 1, 0) - _slope(level, left, y, 1, 0))
            xy = HALF * (_slope(level, x, below, 1, 0) - _slope(level, x, up, 1, 0))
            yy = HALF * (_slope(level, x, below, 0, 1) - _slope(level, x, up, 0, 1))
            per_scale = squares[s] / per
            ridges[first], ridges[first + 1], ridges[first + 2] = xx * per_scale, xy * per_scale, yy * per_scale


@device
def _slope(image: Any, x: Any, y: Any, dx: Any, dy: Any) -> Any:
    """The central difference, per pixel."""
    height, width = image.shape[0], image.shape[1]
    after = image[_mirrored(y + dy, height), _mirrored(x + dx, width), 0]
    return HALF * (after - image[_mirrored(y - dy, height), _mirrored(x - dx, width), 0])


@device
def _mirrored(i: Any, n: Any) -> Any:
    """The index of a pixel that may lie beyond the image, whose borders are mirrors."""
    while n > 1 and (i < 0 or i >= n):
        i = -i if i < 0 else 2 * (n - 1) - i
    return i if n > 1 else 0
