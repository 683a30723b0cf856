"""Appearance, edges and silhouette of many particles, on a GPU: a warp a particle, all in one pass.

What `appearance`, `edges` and `outlines` define, of limbs that `places` has put into the image. A warp's threads share
out the points of all limbs, and then the rows of the outline; sums are added up in one order, whatever the load.
"""

import math
from typing import Any

import numba
import numpy as np
from numba import cuda

from workbench.likelihoods.appearance import AROUND
from workbench.likelihoods.edges.filters import ALONG, LEAST_PX, LOG_WIDTHS
from workbench.likelihoods.edges.model import BINS, EDGE_RANGE, RIDGE_RANGE
from workbench.likelihoods.gpu.places import (
    AX,
    AY,
    BOTTOM,
    COSINE,
    COVERS,
    DH,
    DX,
    DY,
    DZ,
    EX,
    EY,
    FARTHEST,
    HALF,
    HIGH,
    LEFT,
    LIMB,
    LOW,
    NEAREST,
    ONE,
    OUTLINE,
    RIGHT,
    SLOPES,
    TOP,
    TURN,
    TWO,
    UX,
    UY,
    VX,
    VY,
    WX,
    WY,
    ZERO,
    H,
    Z,
    device,
)
from workbench.likelihoods.image_motion.patches import SPHERE, THICKNESS

WARP, PARTICLES = 32, 8  # threads that share a particle, and particles of a block
MOST_LIMBS = 60
APPEARANCE, EDGES, SILHOUETTE, CUES = range(4)
_TURN, _AROUND = np.float32(2.0 * np.pi), np.float32(AROUND)
_FAR, _LEAST, _LEAST_PX, _BINS = np.float32(1e9), np.float32(1e-9), np.float32(LEAST_PX), np.float32(BINS - 1.0)
_EDGE_LOW, _EDGE_BINS = np.float32(EDGE_RANGE[0]), np.float32(BINS / (EDGE_RANGE[1] - EDGE_RANGE[0]))
_RIDGE_LOW, _RIDGE_BINS = np.float32(RIDGE_RANGE[0]), np.float32(BINS / (RIDGE_RANGE[1] - RIDGE_RANGE[0]))
_STEP = np.float32(1.0 / ALONG)
_SPAN = np.float32((ALONG - 1) / ALONG)  # from the first place along a limb to the last
_MIDDLE = np.float32((ALONG // 2 + 0.5) / ALONG)
_SCALE_1, _SCALE_2 = (np.float32(between) for between in (LOG_WIDTHS[1:] + LOG_WIDTHS[:-1]) / 2.0)


@cuda.jit(fastmath=True)
def judge(
    n: int, limbs: Any, table: Any, asked: int, size: Any, points: Any, along: Any, image: Any, template: Any, epsilon: float,
    responses: Any, gradient: Any, ridges: Any, reached: Any, sums: Any,
) -> None:  # fmt: skip
    """Write the cues' sums (CUES, n) over all limbs, (L · LIMB, N) as `place_limbs` writes them, of the first n particles.

    table: see `kernel.limb_table`. asked: a bit for every cue, of those whose arrays are more than a stand-in. size: (2,), of the image, px. points, along: (n, 3) u, v and −arccos v of the
    template's points, and their cells (n,). template: (L, ALONG, AROUND, 3), see `looks.template_cells`. responses: (2,
    L, BINS). reached: (height, width + 1), see `running_sums`.
    """
    rows, seen_by = cuda.shared.array(0, numba.float32), cuda.shared.array((PARTICLES, MOST_LIMBS), numba.int64)
    parts = cuda.shared.array((PARTICLES, CUES, WARP), numba.float32)
    in_turn = cuda.shared.array((PARTICLES, MOST_LIMBS), numba.int32)
    lane, particle, n_limbs = cuda.threadIdx.x, cuda.threadIdx.y, table.shape[0]
    first, thread = cuda.blockIdx.x * PARTICLES, cuda.threadIdx.y * WARP + cuda.threadIdx.x
    i = min(first + thread % PARTICLES, n - 1)
    for row in range(thread // PARTICLES, limbs.shape[0], WARP):  # neighbours in memory by neighbours
        rows[thread % PARTICLES * limbs.shape[0] + row] = limbs[row, i]
    own = rows[particle * limbs.shape[0] : (particle + 1) * limbs.shape[0]]
    cuda.syncthreads()
    for limb in range(lane, n_limbs, WARP):
        seen_by[particle, limb] = _may_hide(own, table, limb, n_limbs)
        in_turn[particle, _place_from_left(own, limb, n_limbs)] = limb
    cuda.syncthreads()
    appearance, edges, silhouette = ZERO, ZERO, ZERO
    if asked & (1 << APPEARANCE):
        for k in range(lane, n_limbs * points.shape[0], WARP):
            limb, s = k // points.shape[0], k % points.shape[0]
            appearance += _appearance(
                own, table, limb, seen_by[particle, limb], size, points[s, 0], points[s, 1], along[s], points[s, 2],
                image, template, epsilon,
            )  # fmt: skip
    if asked & (1 << EDGES):
        for k in range(lane, n_limbs * 3 * ALONG, WARP):
            limb, s = k // (3 * ALONG), k % (3 * ALONG)
            edges += _edge(own, table, limb, seen_by[particle, limb], size, s, responses, gradient, ridges)
    if asked & (1 << SILHOUETTE):
        silhouette = _outline_sum(own, table, in_turn[particle], lane, reached)
    parts[particle, APPEARANCE, lane], parts[particle, EDGES, lane] = appearance, edges
    parts[particle, SILHOUETTE, lane] = silhouette
    cuda.syncthreads()
    if lane < CUES and first + particle < n:
        total = ZERO
        for k in range(WARP):
            total += parts[particle, lane, k]
        sums[lane, first + particle] = total


@device
def _may_hide(rows: Any, table: Any, limb: int, n_limbs: int) -> int:
    """The limbs that may hide points of one, a bit each: those before it whose boxes meet its own."""
    own, found = limb * LIMB, np.int64(0)
    for k in range(n_limbs):
        other = k * LIMB
        margin = HALF * (table[limb, THICKNESS] + table[k, THICKNESS])
        meet = rows[other + LEFT] <= rows[own + RIGHT] and rows[other + RIGHT] >= rows[own + LEFT]
        meet = meet and rows[other + TOP] <= rows[own + BOTTOM] and rows[other + BOTTOM] >= rows[own + TOP]
        meet = meet and rows[other + COVERS] > ZERO
        if k != limb and meet and rows[other + NEAREST] + margin < rows[own + FARTHEST]:
            found |= np.int64(1) << np.int64(k)
    return found


@device
def _place_from_left(rows: Any, limb: int, n_limbs: int) -> int:
    """How many limbs have their middle farther to the left in the image than one, of equals those named before."""
    middle, place = TWO * rows[limb * LIMB + AX] + rows[limb * LIMB + DX], 0
    for k in range(n_limbs):
        other = TWO * rows[k * LIMB + AX] + rows[k * LIMB + DX]
        if other < middle or (other == middle and k < limb):
            place += 1
    return place


@device
def _counts(rows: Any, table: Any, limb: int, seen_by: int, size: Any, u: float, x: float, y: float) -> bool:
    """Whether a point is in the image and no limb hides it."""
    own = limb * LIMB
    inside = x >= ZERO and x < size[0] - ONE and y >= ZERO and y < size[1] - ONE
    if not inside or not rows[own + COSINE] > ZERO:
        return False
    hidden, depth = False, rows[own + Z] + u * rows[own + DZ]
    while seen_by != 0 and not hidden:
        k = cuda.ffs(seen_by) - 1
        seen_by &= seen_by - 1
        other = k * LIMB
        beside_x, beside_y = x - rows[other + AX], y - rows[other + AY]
        s = rows[other + UX] * beside_x + rows[other + UY] * beside_y
        t = rows[other + VX] * beside_x + rows[other + VY] * beside_y
        margin = HALF * (table[limb, THICKNESS] + table[k, THICKNESS])
        if table[k, SPHERE] > ZERO:
            covered = (TWO * s - ONE) * (TWO * s - ONE) + t * t <= TWO
            s = HALF
        else:
            covered = s >= ZERO and s <= ONE and abs(t) <= rows[other + H] + s * rows[other + DH]
        hidden = covered and rows[other + Z] + s * rows[other + DZ] + margin < depth
    return not hidden


@device
def _place(rows: Any, own: int, u: float, v: float) -> Any:
    x = rows[own + AX] + u * rows[own + DX] + v * (rows[own + WX] + u * rows[own + EX])
    return x, rows[own + AY] + u * rows[own + DY] + v * (rows[own + WY] + u * rows[own + EY])


@device
def _appearance(
    rows: Any, table: Any, limb: int, seen_by: int, size: Any, u: float, v: float, along: int, offset: float,
    image: Any, template: Any, epsilon: float,
) -> Any:  # fmt: skip
    x, y = _place(rows, limb * LIMB, u, v)
    azimuth = (rows[limb * LIMB + TURN] + offset) / _TURN
    around = min(np.int32((azimuth - np.float32(math.floor(azimuth))) * _AROUND), AROUND - 1)
    height = template[limb, along, around, 1]
    if not height > ZERO or not _counts(rows, table, limb, seen_by, size, u, x, y):
        return ZERO
    column, row = np.int32(x), np.int32(y)
    fx, fy = x - np.float32(column), y - np.float32(row)
    upper = image[row, column] + fx * (image[row, column + 1] - image[row, column])
    lower = image[row + 1, column] + fx * (image[row + 1, column + 1] - image[row + 1, column])
    miss = upper + fy * (lower - upper) - template[limb, along, around, 0]
    return math.log(epsilon + height * math.exp(template[limb, along, around, 2] * miss * miss))


@device
def _edge(
    rows: Any, table: Any, limb: int, seen_by: int, size: Any, s: int, responses: Any, gradient: Any, ridges: Any
) -> Any:
    own, side = limb * LIMB, s % 3
    u, v = (np.float32(s // 3) + HALF) * _STEP, np.float32(side) - ONE
    tx, ty = _SPAN * (rows[own + DX] + v * rows[own + EX]), _SPAN * (rows[own + DY] + v * rows[own + EY])
    length = math.sqrt(tx * tx + ty * ty)
    x, y = _place(rows, own, u, v)
    if not length > _LEAST_PX or not _counts(rows, table, limb, seen_by, size, u, x, y):
        return ZERO
    tx, ty = tx / length, ty / length
    if side != 1:
        edge = abs(tx * _bilinear(gradient, x, y, 1) - ty * _bilinear(gradient, x, y, 0))
        return responses[0, limb, _bin((edge - _EDGE_LOW) * _EDGE_BINS)]
    wx, wy = rows[own + WX] + _MIDDLE * rows[own + EX], rows[own + WY] + _MIDDLE * rows[own + EY]
    half_width = math.log(max(math.sqrt(wx * wx + wy * wy), _LEAST))
    scale = 2 if half_width > _SCALE_2 else 1 if half_width > _SCALE_1 else 0  # the nearest, of equals the first
    images = ridges[scale]
    xx, xy, yy = _bilinear(images, x, y, 0), _bilinear(images, x, y, 1), _bilinear(images, x, y, 2)
    across = ty * ty * xx - TWO * tx * ty * xy + tx * tx * yy
    ahead = tx * tx * xx + TWO * tx * ty * xy + ty * ty * yy
    return responses[1, limb, _bin((abs(across) - abs(ahead) - _RIDGE_LOW) * _RIDGE_BINS)]


@device
def _bin(value: float) -> int:
    return np.int32(min(max(value, ZERO), _BINS))


@device
def _bilinear(images: Any, x: float, y: float, k: int) -> Any:
    column, row = np.int32(x), np.int32(y)
    fx, fy = x - np.float32(column), y - np.float32(row)
    upper = images[row, column, k] + fx * (images[row, column + 1, k] - images[row, column, k])
    lower = images[row + 1, column, k] + fx * (images[row + 1, column + 1, k] - images[row + 1, column, k])
    return upper + fy * (lower - upper)


@device
def _outline_sum(rows: Any, table: Any, in_turn: Any, lane: int, reached: Any) -> Any:
    """The part of the sum over the outlines' union that lies in every WARPth row, from `lane` on. in_turn: the limbs, so that
    spans come nearly sorted."""
    n_limbs = table.shape[0]
    lefts, rights = cuda.local.array(MOST_LIMBS, numba.float32), cuda.local.array(MOST_LIMBS, numba.float32)
    low, high = np.float32(reached.shape[0]), -ONE
    for limb in range(n_limbs):
        if rows[limb * LIMB + LOW] <= rows[limb * LIMB + HIGH]:
            low, high = min(low, rows[limb * LIMB + LOW]), max(high, rows[limb * LIMB + HIGH])
    first, last = np.int32(max(low, ZERO)), np.int32(min(high, np.float32(reached.shape[0] - 1)))
    width, total = np.float32(reached.shape[1] - 1), ZERO
    for row in range(first + lane, last + 1, WARP):
        y, count = np.float32(row), 0
        for k in range(n_limbs):
            limb = in_turn[k]
            if rows[limb * LIMB + LOW] <= y and y <= rows[limb * LIMB + HIGH]:
                left, right = _span(rows, limb * LIMB + OUTLINE, table[limb, SPHERE] > ZERO, y)
                left, right = max(left + HALF, ZERO), min(right + HALF, width)  # from the image's left edge
                if right > left:
                    place = count
                    while place > 0 and lefts[place - 1] > left:
                        lefts[place], rights[place] = lefts[place - 1], rights[place - 1]
                        place -= 1
                    lefts[place], rights[place] = left, right
                    count += 1
        end = ZERO
        for k in range(count):
            left, right = max(lefts[k], end), rights[k]
            if right > left:
                total += _until(reached, row, right) - _until(reached, row, left)
                end = right
    return total


@device
def _span(rows: Any, outline: int, sphere: bool, y: float) -> Any:
    """Where a row meets an outline; the right end is before the left where it does not."""
    if sphere:
        x, radius = rows[outline], rows[outline + 2]
        half = math.sqrt(max(radius * radius - (y - rows[outline + 1]) * (y - rows[outline + 1]), ZERO))
        return x - half, x + half
    left, right = -_FAR, _FAR
    for k in range(4):  # the sides that go down are on the right
        x0, y0 = rows[outline + 2 * k], rows[outline + 2 * k + 1]
        x = x0 + (y - y0) * rows[outline + SLOPES - OUTLINE + k]
        if rows[outline + 2 * ((k + 1) % 4) + 1] > y0:
            right = min(right, x)
        else:
            left = max(left, x)
    return left, right


@device
def _until(reached: Any, row: int, x: float) -> Any:
    """The sum of the row from its left edge to x."""
    first = min(np.int32(x), reached.shape[1] - 2)
    return reached[row, first] + (x - np.float32(first)) * (reached[row, first + 1] - reached[row, first])
