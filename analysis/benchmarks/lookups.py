"""Bare loops of bilinear lookups at given places: what the image-motion likelihood cannot do without.

Each takes M places, px, and returns the sum of the grey levels there; nothing else is computed.
"""

from typing import Any

import numba
import numpy as np

from workbench.body.simd_kinematics import FAST
from workbench.utils.arrays import Float32Array


@numba.njit(nogil=True, error_model="numpy", fastmath=FAST)
def float32_lookups(image: Any, x: Any, y: Any) -> float:
    """Four loads a place from a float32 image (height, width), one place after the other."""
    total = 0.0
    for i in range(x.shape[0]):
        column, row = np.uint32(x[i]), np.uint32(y[i])  # unsigned indices spare numba's test for negative ones
        right, below = np.uint32(column + np.uint32(1)), np.uint32(row + np.uint32(1))
        fx, fy = x[i] - np.float32(column), y[i] - np.float32(row)
        top = image[row, column] + fx * (image[row, right] - image[row, column])
        bottom = image[below, column] + fx * (image[below, right] - image[below, column])
        total += top + fy * (bottom - top)
    return total


@numba.njit(nogil=True, error_model="numpy", fastmath=FAST)
def packed_lookups(words: Any, x: Any, y: Any, bits: int) -> float:
    """One load a place of four levels of 8 or 16 bits, from an image (height, width) of words."""
    total, mask = 0.0, np.uint64((1 << bits) - 1)
    shift = np.uint64(bits)
    for i in range(x.shape[0]):
        column, row = np.uint32(x[i]), np.uint32(y[i])
        fx, fy = x[i] - np.float32(column), y[i] - np.float32(row)
        word = np.uint64(words[row, column])
        a, b = np.float32(np.int32(word & mask)), np.float32(np.int32((word >> shift) & mask))
        word = word >> (shift + shift)
        c, d = np.float32(np.int32(word & mask)), np.float32(np.int32((word >> shift) & mask))
        top, bottom = a + fx * (b - a), c + fx * (d - c)
        total += top + fy * (bottom - top)
    return total


def packed_bytes(image: Float32Array) -> Any:
    """Words (height, width) of 32 bits: of every pixel and its neighbours to the right, below and both, 8 bits each."""
    levels = np.pad(np.round(image), ((0, 1), (0, 1)), "edge").astype(np.uint32)
    upper, lower = levels[:-1, :-1] | levels[:-1, 1:] << 8, levels[1:, :-1] | levels[1:, 1:] << 8
    return upper | lower << 16
