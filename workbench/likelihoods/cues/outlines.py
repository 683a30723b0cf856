"""Sums of an image over the union of overlapping outlines, by rows: each outline covers one interval of a row."""

from functools import lru_cache
from typing import Any

import numpy as np

from workbench.body.simd_kinematics import FAST, inlined
from workbench.utils.arrays import BoolArray, Float32Array, FloatArray
from workbench.utils.kernel_cache import kernel
from workbench.utils.parallel import parallel_for

CORNERS = np.array([[0.0, -1.0], [0.0, 1.0], [1.0, 1.0], [1.0, -1.0]])  # of a patch (u, v), in order around it
OUTWARDS = np.column_stack([2.0 * CORNERS[:, 0] - 1.0, CORNERS[:, 1]])
"""Directions of the corners from the middle of the limb, along it and across it."""
_ROWS, _PARTICLES = 64, 64  # minimum rows of an image, and particles, per thread


def running_sums(image: Float32Array) -> FloatArray:
    """Return sums (height, width + 1) of every row of the image from its left edge to each edge between pixels."""
    row_sums = np.empty((image.shape[0], image.shape[1] + 1))
    parallel_for(lambda first, last: _add_up(image[first:last], row_sums[first:last]), len(image), _ROWS)
    return row_sums


@lru_cache(maxsize=4)
def areas(height: int, width: int) -> FloatArray:
    """Return the read-only running sums of an image of ones, for which `outline_sums` are areas, px²."""
    return np.tile(np.arange(width + 1.0), (height, 1))


def outline_sums(
    row_sums: FloatArray, corners: Float32Array, spheres: BoolArray, dilation_px: float = 0.0
) -> FloatArray:
    """Return sums (N,) over the union of L outlines; a pixel is weighted by the covered fraction of its row interval.

    Parameters
    ----------
    row_sums : the image's `running_sums`.
    corners : (N, L, 4, 2), px, in the order of CORNERS; four equal corners for an invisible limb.
    spheres : (L,), limbs whose outline is the circle through its corners.
    dilation_px : of the outlines on all sides.
    """
    sums = np.empty(len(corners))
    arguments = (row_sums, corners, spheres, dilation_px, sums)
    parallel_for(lambda first, last: _outline_sums(first, last, *arguments), len(corners), _PARTICLES)
    return sums


@kernel()
def _add_up(image: Any, row_sums: Any) -> None:
    for row in range(image.shape[0]):
        total = 0.0
        row_sums[row, 0] = total
        for column in range(image.shape[1]):
            total += image[row, column]
            row_sums[row, column + 1] = total


@kernel(error_model="numpy", fastmath=FAST)
def _outline_sums(
    first: int, last: int, row_sums: Any, corners: Any, spheres: Any, dilation_px: float, sums: Any
) -> None:
    height, width = row_sums.shape[0], row_sums.shape[1] - 1
    n_limbs = corners.shape[1]
    lefts, rights = np.empty((height, n_limbs)), np.empty((height, n_limbs))
    counts, outline = np.empty(height, dtype=np.int64), np.empty((4, 2))
    for i in range(first, last):
        top, bottom = height, -1
        for y in range(height):
            counts[y] = 0
        for limb in range(n_limbs):
            if not _dilated(corners[i, limb], dilation_px, outline):
                continue
            if spheres[limb]:
                low, high = _disc_spans(corners[i, limb], dilation_px, width, counts, lefts, rights)
            else:
                low, high = _spans(outline, width, counts, lefts, rights)
            top, bottom = min(top, low), max(bottom, high)
        total = 0.0
        for y in range(top, bottom + 1):
            total += _union(row_sums[y], counts[y], lefts[y], rights[y])
        sums[i] = total


@inlined
def _dilated(corners: Any, dilation_px: float, outline: Any) -> bool:
    """Write the outline's corners, moved outwards along the limb and across it; return False for an invisible limb."""
    ax = corners[2, 0] + corners[3, 0] - corners[0, 0] - corners[1, 0]
    ay = corners[2, 1] + corners[3, 1] - corners[0, 1] - corners[1, 1]
    bx = corners[1, 0] + corners[2, 0] - corners[0, 0] - corners[3, 0]
    by = corners[1, 1] + corners[2, 1] - corners[0, 1] - corners[3, 1]
    a, b = np.sqrt(np.float64(ax * ax + ay * ay)), np.sqrt(np.float64(bx * bx + by * by))
    if not min(a, b) > 0.0:
        return False
    for k in range(4):
        along, across = dilation_px * OUTWARDS[k, 0] / a, dilation_px * OUTWARDS[k, 1] / b
        outline[k, 0] = corners[k, 0] + along * ax + across * bx
        outline[k, 1] = corners[k, 1] + along * ay + across * by
    return True


@inlined
def _disc_spans(corners: Any, dilation_px: float, width: int, counts: Any, lefts: Any, rights: Any) -> tuple[int, int]:
    """Add every row's intersection with a disc; return the first and the last row that may have one."""
    x = 0.25 * (corners[0, 0] + corners[1, 0] + corners[2, 0] + corners[3, 0])
    y = 0.25 * (corners[0, 1] + corners[1, 1] + corners[2, 1] + corners[3, 1])
    dx, dy = corners[2, 0] - corners[0, 0], corners[2, 1] - corners[0, 1]
    radius = 0.5 * np.sqrt(np.float64(dx * dx + dy * dy)) + dilation_px
    low, high = _rows(y - radius, y + radius, counts.shape[0])
    for row in range(low, high + 1):
        square = radius * radius - (row - y) * (row - y)
        if square > 0.0:
            half = np.sqrt(square)
            _add(row, x - half, x + half, width, counts, lefts, rights)
    return low, high


@inlined
def _spans(outline: Any, width: int, counts: Any, lefts: Any, rights: Any) -> tuple[int, int]:
    """Add every row's intersection with a quadrangle; return as `_disc_spans`."""
    a, b, c, d = outline[0, 1], outline[1, 1], outline[2, 1], outline[3, 1]
    low, high = _rows(min(min(a, b), min(c, d)), max(max(a, b), max(c, d)), counts.shape[0])
    for row in range(low, high + 1):
        left, right = np.inf, -np.inf
        for k in range(4):
            x0, y0, x1, y1 = outline[k, 0], outline[k, 1], outline[(k + 1) % 4, 0], outline[(k + 1) % 4, 1]
            if min(y0, y1) <= row and row < max(y0, y1):
                x = x0 + (row - y0) / (y1 - y0) * (x1 - x0)
                left, right = min(left, x), max(right, x)
        if right > left:
            _add(row, left, right, width, counts, lefts, rights)
    return low, high


@inlined
def _rows(above: float, below: float, height: int) -> tuple[int, int]:
    """Return the first and last row of the image between two heights; the last precedes the first if there is none."""
    low, high = max(np.ceil(above), 0.0), min(np.floor(below), height - 1.0)
    if not low <= high:  # also for NaN
        return height, -1
    return int(low), int(high)


@inlined
def _add(row: int, left: float, right: float, width: int, counts: Any, lefts: Any, rights: Any) -> None:
    """Insert an interval into its row, sorted by left ends."""
    left, right = max(left + 0.5, 0.0), min(right + 0.5, float(width))  # from the image's left edge
    if not right > left:
        return
    place = counts[row]
    while place > 0 and lefts[row, place - 1] > left:
        lefts[row, place], rights[row, place] = lefts[row, place - 1], rights[row, place - 1]
        place -= 1
    lefts[row, place], rights[row, place] = left, right
    counts[row] += 1


@inlined
def _union(row_sums: Any, count: int, lefts: Any, rights: Any) -> float:
    """Return the row's sum over the union of its intervals."""
    total, end = 0.0, 0.0
    for k in range(count):
        left, right = max(lefts[k], end), rights[k]
        if right > left:
            total += _sum_to(row_sums, right) - _sum_to(row_sums, left)
            end = right
    return total


@inlined
def _sum_to(row_sums: Any, x: float) -> Any:
    """Return the sum of the row from its left edge to x."""
    first = min(int(x), row_sums.shape[0] - 2)
    return row_sums[first] + (x - first) * (row_sums[first + 1] - row_sums[first])
