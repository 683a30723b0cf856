"""Appearance, edges and silhouette of many particles, on a GPU: a warp a particle, all in one pass.

What `appearance`, `edges` and `outlines` define, of limbs that `places` has put into the image. A warp's threads share
out the points of all limbs, and then the rows of the outline; sums are added up in one order, whatever the load.
"""

import math
from typing import Any

import numba.cuda
import numpy as np

from workbench.likelihoods.appearance import ALONG as ALONG_TEMPLATE
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

cuda: Any = numba.cuda
_f32: Any = np.float32
COLUMNS = THICKNESS + 1  # of the limbs' table

WARP, PARTICLES = 32, 8  # threads that share a particle, and particles of a block
MOST_LIMBS = 34  # whose rows and the rest of a block find room in 48 kB of shared memory
APPEARANCE, EDGES, SILHOUETTE, CUES = range(4)
_TURN, _AROUND = _f32(2.0 * np.pi), _f32(AROUND)
_FAR, _LEAST, _LEAST_PX, _BINS = _f32(1e9), _f32(1e-9), _f32(LEAST_PX), _f32(BINS - 1.0)
_EDGE_LOW, _EDGE_BINS = _f32(EDGE_RANGE[0]), _f32(BINS / (EDGE_RANGE[1] - EDGE_RANGE[0]))
_RIDGE_LOW, _RIDGE_BINS = _f32(RIDGE_RANGE[0]), _f32(BINS / (RIDGE_RANGE[1] - RIDGE_RANGE[0]))
_STEP = _f32(1.0 / ALONG)
_SPAN = _f32((ALONG - 1) / ALONG)  # from the first place along a limb to the last
_MIDDLE = _f32((ALONG // 2 + 0.5) / ALONG)
_SCALE_1, _SCALE_2 = (_f32(between) for between in (LOG_WIDTHS[1:] + LOG_WIDTHS[:-1]) / 2.0)

# With 48 registers five blocks find room on a multiprocessor. The simulator knows no such limit.
_LIMITS: Any = {} if numba.config.ENABLE_CUDASIM else {"max_registers": 48}  # type: ignore[attr-defined]


@cuda.jit(fastmath=True, **_LIMITS)
def judge(
    n: Any, limbs: Any, n_limbs: Any, table: Any, asked: Any, width: Any, height: Any, n_points: Any, points: Any,
    image: Any, template: Any, epsilon: Any, responses: Any, gradient: Any, ridges: Any,
    reached: Any, sums: Any,
) -> None:  # fmt: skip
    """Write the cues' sums (CUES, N) of the first n particles, over all limbs, (L · LIMB, N) as `place_limbs` writes
    them. Other arrays are in one piece.

    table: see `kernel.limb_table`. asked: a bit for every cue, of those whose arrays are more than a stand-in. width,
    height: of the image, px. points: (n_points, 4) of the template's points u, v, −arccos v and their cells along the
    limb. template: (L, ALONG, AROUND, 3), see `looks.template_cells`. responses: (2, L, BINS). gradient, ridges: see
    `Filtered`, of the whole image. reached: (height, width + 1), see `running_sums`.
    """
    rows, seen_by = cuda.shared.array(0, numba.float32), cuda.shared.array((PARTICLES, MOST_LIMBS), numba.int64)
    parts = cuda.shared.array((PARTICLES, CUES, WARP), numba.float32)
    in_turn = cuda.shared.array((PARTICLES, MOST_LIMBS), numba.uint32)
    lane, particle = cuda.threadIdx.x, cuda.threadIdx.y
    first, thread = cuda.blockIdx.x * PARTICLES, cuda.threadIdx.y * WARP + cuda.threadIdx.x
    i = min(first + thread % PARTICLES, n - 1)
    for row in range(thread // PARTICLES, limbs.shape[0], WARP):  # neighbours in memory by neighbours
        rows[np.uint32(thread % PARTICLES * limbs.shape[0] + row)] = limbs[row, i]
    own = rows[particle * limbs.shape[0] : (particle + 1) * limbs.shape[0]]
    cuda.syncthreads()
    for limb in range(lane, n_limbs, WARP):
        seen_by[particle, limb] = _may_hide(own, table, limb, n_limbs)
        in_turn[particle, limb] = 0  # as limbs that are too far away for float32 to tell their order leave places empty
    cuda.syncthreads()
    for limb in range(lane, n_limbs, WARP):
        disc = 1 if _at(table, limb * COLUMNS + SPHERE) > ZERO else 0
        in_turn[particle, _place_from_left(own, limb, n_limbs)] = 2 * limb * LIMB + disc
    cuda.syncthreads()
    appearance, edges, silhouette = ZERO, ZERO, ZERO
    if asked & (1 << APPEARANCE):
        for k in range(lane, n_limbs * n_points, WARP):
            limb, s = k // n_points, k % n_points
            hiding = seen_by[particle, limb]
            appearance += _appearance(own, table, limb, hiding, width, height, 4 * s, points, image, template, epsilon)
    if asked & (1 << EDGES):
        for k in range(lane, n_limbs * 3 * ALONG, WARP):
            limb, s = k // (3 * ALONG), k % (3 * ALONG)
            hiding = seen_by[particle, limb]
            edges += _edge(own, table, n_limbs, limb, hiding, width, height, s, responses, gradient, ridges)
    if asked & (1 << SILHOUETTE):
        silhouette = _outline_sum(own, n_limbs, in_turn[particle], lane, width, height, reached)
    parts[particle, APPEARANCE, lane], parts[particle, EDGES, lane] = appearance, edges
    parts[particle, SILHOUETTE, lane] = silhouette
    cuda.syncthreads()
    if lane < CUES and first + particle < n:
        total = ZERO
        for k in range(WARP):
            total += parts[particle, lane, k]
        sums[lane, first + particle] = total


@device
def _may_hide(rows: Any, table: Any, limb: Any, n_limbs: Any) -> Any:
    """The limbs that may hide points of one, a bit each: those before it whose boxes meet its own."""
    own, found = limb * LIMB, np.int64(0)
    for k in range(n_limbs):
        other = k * LIMB
        margin = HALF * (_at(table, limb * COLUMNS + THICKNESS) + _at(table, k * COLUMNS + THICKNESS))
        meet = _at(rows, other + LEFT) <= _at(rows, own + RIGHT) and _at(rows, other + RIGHT) >= _at(rows, own + LEFT)
        meet = meet and _at(rows, other + TOP) <= _at(rows, own + BOTTOM)
        meet = meet and _at(rows, other + BOTTOM) >= _at(rows, own + TOP)
        meet = meet and _at(rows, other + COVERS) > ZERO
        if k != limb and meet and _at(rows, other + NEAREST) + margin < _at(rows, own + FARTHEST):
            found |= np.int64(1) << np.int64(k)
    return found


@device
def _place_from_left(rows: Any, limb: Any, n_limbs: Any) -> Any:
    """How many limbs have their middle farther to the left in the image than one, of equals those named before."""
    middle, place = TWO * _at(rows, limb * LIMB + AX) + _at(rows, limb * LIMB + DX), 0
    for k in range(n_limbs):
        other = TWO * _at(rows, k * LIMB + AX) + _at(rows, k * LIMB + DX)
        if other < middle or (other == middle and k < limb):
            place += 1
    return place


@device
def _counts(rows: Any, table: Any, limb: Any, seen_by: Any, width: Any, height: Any, u: Any, x: Any, y: Any) -> Any:
    """Whether a point is in the image and no limb hides it."""
    own = limb * LIMB
    inside = x >= ZERO and x < np.float32(width - 1) and y >= ZERO and y < np.float32(height - 1)
    if not inside or not _at(rows, own + COSINE) > ZERO:
        return False
    hidden, depth = False, _at(rows, own + Z) + u * _at(rows, own + DZ)
    while seen_by != 0 and not hidden:
        k = cuda.ffs(seen_by) - 1
        seen_by &= seen_by - 1
        other = k * LIMB
        beside_x, beside_y = x - _at(rows, other + AX), y - _at(rows, other + AY)
        s = _at(rows, other + UX) * beside_x + _at(rows, other + UY) * beside_y
        t = _at(rows, other + VX) * beside_x + _at(rows, other + VY) * beside_y
        margin = HALF * (_at(table, limb * COLUMNS + THICKNESS) + _at(table, k * COLUMNS + THICKNESS))
        if _at(table, k * COLUMNS + SPHERE) > ZERO:
            covered = (TWO * s - ONE) * (TWO * s - ONE) + t * t <= TWO
            s = HALF
        else:
            covered = s >= ZERO and s <= ONE and abs(t) <= _at(rows, other + H) + s * _at(rows, other + DH)
        hidden = covered and _at(rows, other + Z) + s * _at(rows, other + DZ) + margin < depth
    return not hidden


@device
def _place(rows: Any, own: Any, u: Any, v: Any) -> Any:
    x = _at(rows, own + AX) + u * _at(rows, own + DX) + v * (_at(rows, own + WX) + u * _at(rows, own + EX))
    return x, _at(rows, own + AY) + u * _at(rows, own + DY) + v * (_at(rows, own + WY) + u * _at(rows, own + EY))


@device
def _appearance(
    rows: Any, table: Any, limb: Any, seen_by: Any, width: Any, height: Any, point: Any, points: Any, image: Any,
    template: Any, epsilon: Any,
) -> Any:  # fmt: skip
    u, v, along = _at(points, point), _at(points, point + 1), np.int32(_at(points, point + 3))
    x, y = _place(rows, limb * LIMB, u, v)
    azimuth = (_at(rows, limb * LIMB + TURN) + _at(points, point + 2)) / _TURN
    around = min(np.int32((azimuth - np.float32(math.floor(azimuth))) * _AROUND), AROUND - 1)
    cell = 3 * ((limb * ALONG_TEMPLATE + along) * AROUND + around)
    peak = _at(template, cell + 1)
    if not peak > ZERO or not _counts(rows, table, limb, seen_by, width, height, u, x, y):
        return ZERO
    miss = _bilinear(image, width, 1, x, y, 0) - _at(template, cell)
    return math.log(epsilon + peak * math.exp(_at(template, cell + 2) * miss * miss))


@device
def _edge(
    rows: Any, table: Any, n_limbs: Any, limb: Any, seen_by: Any, width: Any, height: Any, s: Any, responses: Any,
    gradient: Any, ridges: Any,
) -> Any:  # fmt: skip
    own, side = limb * LIMB, s % 3
    u, v = (np.float32(s // 3) + HALF) * _STEP, np.float32(side) - ONE
    tx = _SPAN * (_at(rows, own + DX) + v * _at(rows, own + EX))
    ty = _SPAN * (_at(rows, own + DY) + v * _at(rows, own + EY))
    length = math.sqrt(tx * tx + ty * ty)
    x, y = _place(rows, own, u, v)
    if not length > _LEAST_PX or not _counts(rows, table, limb, seen_by, width, height, u, x, y):
        return ZERO
    tx, ty = tx / length, ty / length
    if side != 1:
        edge = abs(tx * _bilinear(gradient, width, 2, x, y, 1) - ty * _bilinear(gradient, width, 2, x, y, 0))
        return _at(responses, limb * BINS + _bin((edge - _EDGE_LOW) * _EDGE_BINS))
    wx, wy = _at(rows, own + WX) + _MIDDLE * _at(rows, own + EX), _at(rows, own + WY) + _MIDDLE * _at(rows, own + EY)
    half_width = math.log(max(math.sqrt(wx * wx + wy * wy), _LEAST))
    scale = 2 if half_width > _SCALE_2 else 1 if half_width > _SCALE_1 else 0  # the nearest, of equals the first
    first = 3 * scale * height * width
    xx, xy = _bilinear(ridges, width, 3, x, y, first), _bilinear(ridges, width, 3, x, y, first + 1)
    yy = _bilinear(ridges, width, 3, x, y, first + 2)
    across = ty * ty * xx - TWO * tx * ty * xy + tx * tx * yy
    ahead = tx * tx * xx + TWO * tx * ty * xy + ty * ty * yy
    return _at(responses, (n_limbs + limb) * BINS + _bin((abs(across) - abs(ahead) - _RIDGE_LOW) * _RIDGE_BINS))


@device
def _bin(value: Any) -> Any:
    return np.int32(min(max(value, ZERO), _BINS))


@device
def _bilinear(images: Any, width: Any, n: Any, x: Any, y: Any, k: Any) -> Any:
    """The value at a point of one of n images that lie pixel by pixel; k: where its first pixel is."""
    column, row = np.int32(x), np.int32(y)
    fx, fy = x - np.float32(column), y - np.float32(row)
    above = (row * width + column) * n + k
    below = above + width * n
    upper = _at(images, above) + fx * (_at(images, above + n) - _at(images, above))
    lower = _at(images, below) + fx * (_at(images, below + n) - _at(images, below))
    return upper + fy * (lower - upper)


@device
def _outline_sum(rows: Any, n_limbs: Any, in_turn: Any, lane: Any, width: Any, height: Any, reached: Any) -> Any:
    """The part of the sum over the outlines' union that lies in every WARPth row, from `lane` on. in_turn: where
    the limbs' rows are, twice, and 1 more for discs; from left to right, so that spans come nearly sorted."""
    lefts, rights = cuda.local.array(MOST_LIMBS, numba.float32), cuda.local.array(MOST_LIMBS, numba.float32)
    low, high = np.float32(height), -ONE
    for limb in range(n_limbs):
        if _at(rows, limb * LIMB + LOW) <= _at(rows, limb * LIMB + HIGH):
            low, high = min(low, _at(rows, limb * LIMB + LOW)), max(high, _at(rows, limb * LIMB + HIGH))
    first, last = np.int32(max(low, ZERO)), np.int32(min(high, np.float32(height - 1)))
    total = ZERO
    for row in range(first + lane, last + 1, WARP):
        y, count = np.float32(row), 0
        for k in range(n_limbs):
            own = _at(in_turn, k) >> np.uint32(1)
            if _at(rows, own + np.uint32(LOW)) <= y and y <= _at(rows, own + np.uint32(HIGH)):
                left, right = _span(rows, own + np.uint32(OUTLINE), _at(in_turn, k) & np.uint32(1) == np.uint32(1), y)
                left, right = max(left + HALF, ZERO), min(right + HALF, np.float32(width))  # from the image's left edge
                if right > left:
                    place = count
                    while place > 0 and _at(lefts, place - 1) > left:
                        lefts[np.uint32(place)] = _at(lefts, place - 1)
                        rights[np.uint32(place)] = _at(rights, place - 1)
                        place -= 1
                    lefts[np.uint32(place)], rights[np.uint32(place)] = left, right
                    count += 1
        end = ZERO
        for k in range(count):
            left, right = max(_at(lefts, k), end), _at(rights, k)
            if right > left:
                total += _until(reached, width, row, right) - _until(reached, width, row, left)
                end = right
    return total


@device
def _span(rows: Any, outline: Any, sphere: Any, y: Any) -> Any:
    """Where a row meets an outline; the right end is before the left where it does not."""
    if sphere:
        x, beside = _at(rows, outline), y - _at(rows, outline + np.uint32(1))
        radius = _at(rows, outline + np.uint32(2))
        half = math.sqrt(max(radius * radius - beside * beside, ZERO))
        return x - half, x + half
    left, right, slopes = -_FAR, _FAR, outline + np.uint32(SLOPES - OUTLINE)
    for k in range(4):  # the sides that go down are on the right
        corner, other = outline + np.uint32(2 * k), outline + np.uint32((2 * k + 2) % 8)
        y0 = _at(rows, corner + np.uint32(1))
        x = _at(rows, corner) + (y - y0) * _at(rows, slopes + np.uint32(k))
        if _at(rows, other + np.uint32(1)) > y0:
            right = min(right, x)
        else:
            left = max(left, x)
    return left, right


@device
def _until(reached: Any, width: Any, row: Any, x: Any) -> Any:
    """The sum of the row from its left edge to x."""
    first = min(np.int32(x), width - 1)
    place = row * (width + 1) + first
    return _at(reached, place) + (x - np.float32(first)) * (_at(reached, place + 1) - _at(reached, place))


@device
def _at(array: Any, k: Any) -> Any:
    """A number of an array (N,). An index that may be negative would be tested for it, and reckoned in 64 bits."""
    return array[np.uint32(k)]
