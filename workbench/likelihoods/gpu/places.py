"""Where the limbs are seen, on a GPU: a thread a particle, all in float32.

What `kinematics.forward`, `image_motion.patches` and `outlines` define, of one particle instead of LANES. Numbers are
float32 throughout: a float64 of Python's, such as 0.5, would make all that it meets float64.
"""

import math
from typing import Any

import numba.cuda
import numpy as np

from workbench.likelihoods.image_motion.patches import (
    CENTRE,
    DISTORTION,
    END,
    END_RADII,
    FOCAL,
    MIN_AREA,
    MIN_DEPTH,
    MIN_SINE,
    SPHERE,
    START,
    START_RADII,
    TRANSLATION,
)

cuda: Any = numba.cuda
_f32: Any = np.float32
_i32: Any = np.int32
ZERO, HALF, ONE, TWO = _f32(0.0), _f32(0.5), _f32(1.0), _f32(2.0)
_TINY, _NEAR = _f32(1e-12), _f32(MIN_DEPTH)
_LEAST_SINE2, _LEAST_AREA, _ROOT_2 = _f32(MIN_SINE**2), _f32(MIN_AREA), _f32(math.sqrt(2.0))
_FAR, _LEAST_RISE = _f32(1e9), _f32(1e-6)
_SCREEN = _f32(1e6)  # px, beyond which no row of an image is looked for
_EXPONENT = _i32(0x7F800000)
POSITION, FRAME = 9, 12  # rows of a joint's frame
(
    AX, DX, WX, EX, AY, DY, WY, EY, Z, DZ, COSINE, TURN,  # of a patch, see `patches`; the azimuth of its side at v = 1
    UX, UY, VX, VY, H, DH, COVERS, LEFT, RIGHT, TOP, BOTTOM, NEAREST, FARTHEST,  # of what it covers, see `patches`
    OUTLINE, _, _, _, _, _, _, _, SLOPES, _, _, _, LOW, HIGH,  # of its outline, see `_place_outline`
    LIMB,
) = range(40)  # fmt: skip
"""Rows of a limb; their number is odd, so that the threads of a warp meet different banks of memory."""

device = cuda.jit(device=True, fastmath=True)


@cuda.jit(fastmath=True)
def place_limbs(
    n: Any, poses: Any, finite: Any, parents: Any, offsets: Any, dof_joints: Any, dof_axes: Any, table: Any,
    joints: Any, camera: Any, rim_px: Any, frames: Any, limbs: Any,
) -> None:  # fmt: skip
    """Write frames (J, FRAME, N) of the joints and the rows of the limbs (L, LIMB, N) for the first n poses (N, P), and
    which of these are finite (N,): of others, what is written is that of the pose of zeros. table: see
    `kernel.limb_table`; camera: see `Camera.row`; rim_px: by which outlines are wider."""
    i = cuda.grid(1)
    if i < n:
        finite[i] = _make_finite(poses[i])
        _forward(poses[i], i, parents, offsets, dof_joints, dof_axes, frames)
        for limb in range(joints.shape[0]):
            _place_patch(table[limb], frames[joints[limb]], camera, i, limbs[limb])
            _place_cover(table[limb], i, limbs[limb])
            _place_outline(table[limb], rim_px, i, limbs[limb])


@device
def _make_finite(pose: Any) -> Any:
    """1 where all numbers are finite; otherwise 0, and all become 0. By their bits: compilers may assume such numbers
    away."""
    bits, finite = pose.view(np.int32), np.int8(1)
    for p in range(pose.shape[0]):
        if bits[p] & _EXPONENT == _EXPONENT:
            finite = np.int8(0)
    if finite == 0:
        for p in range(pose.shape[0]):
            pose[p] = ZERO
    return finite


@device
def _forward(pose: Any, i: Any, parents: Any, offsets: Any, dof_joints: Any, dof_axes: Any, frames: Any) -> None:
    p = 3
    for j in range(parents.shape[0]):
        a, b, c = (ONE, ZERO, ZERO), (ZERO, ONE, ZERO), (ZERO, ZERO, ONE)
        at = pose[0], pose[1], pose[2]
        if parents[j] >= 0:
            above = frames[parents[j]]
            a, b, c = _row(above, 0, i), _row(above, 3, i), _row(above, 6, i)
            offset, origin = (offsets[j, 0], offsets[j, 1], offsets[j, 2]), _row(above, POSITION, i)
            at = origin[0] + _dot(a, offset), origin[1] + _dot(b, offset), origin[2] + _dot(c, offset)
        while p < pose.shape[0] and dof_joints[p] == j:
            x, y, z = dof_axes[p, 0], dof_axes[p, 1], dof_axes[p, 2]
            s, r = math.sin(pose[p]), math.cos(pose[p])
            t = ONE - r
            u = r + t * x * x, t * x * y + s * z, t * x * z - s * y  # Rodrigues' formula, by columns
            v = t * x * y - s * z, r + t * y * y, t * y * z + s * x
            w = t * x * z + s * y, t * y * z - s * x, r + t * z * z
            a, b, c = _times(a, u, v, w), _times(b, u, v, w), _times(c, u, v, w)
            p += 1
        for k in range(3):
            frames[j, k, i], frames[j, 3 + k, i], frames[j, 6 + k, i] = a[k], b[k], c[k]
            frames[j, POSITION + k, i] = at[k]


@device
def _place_patch(limb: Any, frame: Any, camera: Any, i: Any, out: Any) -> None:
    sphere = limb[SPHERE] > ZERO
    radius = limb[START_RADII] / _ROOT_2
    x_axis, y_axis = _seen(camera, frame, 0, i), _seen(camera, frame, 1, i)
    z_axis, origin = _seen(camera, frame, 2, i), _seen_place(camera, frame, i)
    start, end = _along(x_axis, y_axis, z_axis, origin, limb, START), _along(x_axis, y_axis, z_axis, origin, limb, END)
    axis = z_axis if sphere else _unit(_add(end, -ONE, start))
    sight = _add(start, ONE, end)
    across = _cross(sight, axis)
    usable = _dot(across, across) > _LEAST_SINE2 * _dot(sight, sight)
    across = _unit(across)
    x, y = _dot(x_axis, across), _dot(y_axis, across)
    start_width = _norm(limb[START_RADII] * x, limb[START_RADII + 1] * y)
    end_width = _norm(limb[END_RADII] * x, limb[END_RADII + 1] * y)
    cosine = _norm(axis[0], axis[1])
    if sphere:
        cosine, start_width, end_width = ONE, radius, radius
        upright = _cross(across, _unit(sight))
        start, end = _add(start, -radius, upright), _add(end, radius, upright)
    a, b = _add(start, -start_width, across), _add(start, start_width, across)
    c, d = _add(end, -end_width, across), _add(end, end_width, across)
    usable = usable and min(min(a[2], b[2]), min(c[2], d[2])) > _NEAR
    ax, ay = _project(camera, a)
    bx, by = _project(camera, b)
    cx, cy = _project(camera, c)
    dx, dy = _project(camera, d)
    _write(out, AX, i, ax, bx, cx, dx, usable)
    _write(out, AY, i, ay, by, cy, dy, usable)
    out[Z, i], out[DZ, i] = start[2], end[2] - start[2]
    out[COSINE, i], out[TURN, i] = cosine if usable else ZERO, math.atan2(y, x) if usable else ZERO


@device
def _write(out: Any, row: Any, i: Any, a: Any, b: Any, c: Any, d: Any, usable: Any) -> None:
    out[row, i], out[row + 1, i] = HALF * (a + b) if usable else ZERO, HALF * (c + d - a - b) if usable else ZERO
    out[row + 2, i] = HALF * (b - a) if usable else ZERO
    out[row + 3, i] = HALF * (d - c - b + a) if usable else ZERO


@device
def _place_cover(limb: Any, i: Any, out: Any) -> None:
    dx, dy, ex, ey = out[DX, i], out[DY, i], out[EX, i], out[EY, i]
    wx, wy = out[WX, i] + HALF * ex, out[WY, i] + HALF * ey  # half the width, in the middle
    area = dx * wy - dy * wx
    covers = out[COSINE, i] > ZERO and abs(area) > _LEAST_AREA
    scale, half = ONE / area if covers else ZERO, _norm(wx, wy) if covers else ONE
    out[UX, i], out[UY, i], out[VX, i], out[VY, i] = wy * scale, -wx * scale, -dy * scale, dx * scale
    first, last = _norm(wx - HALF * ex, wy - HALF * ey) / half, _norm(wx + HALF * ex, wy + HALF * ey) / half
    out[H, i], out[DH, i], out[COVERS, i] = first, last - first, ONE if covers else ZERO
    widest = max(first, last)
    reach_x, reach_y = HALF * abs(dx) + widest * abs(wx), HALF * abs(dy) + widest * abs(wy)
    if limb[SPHERE] > ZERO:
        reach_x, reach_y = _ROOT_2 * _norm(HALF * dx, wx), _ROOT_2 * _norm(HALF * dy, wy)
    x, y = out[AX, i] + HALF * dx, out[AY, i] + HALF * dy
    out[LEFT, i], out[RIGHT, i] = x - reach_x if covers else _FAR, x + reach_x if covers else -_FAR
    out[TOP, i], out[BOTTOM, i] = y - reach_y, y + reach_y
    out[NEAREST, i] = min(out[Z, i], out[Z, i] + out[DZ, i])
    out[FARTHEST, i] = max(out[Z, i], out[Z, i] + out[DZ, i])


@device
def _place_outline(limb: Any, rim_px: Any, i: Any, out: Any) -> None:
    """Write the outline, wider by a rim: a disc's centre and radius, or corners, so that the inside is on the right of
    whoever goes around, and the sides' slopes dx/dy. And the first and the last row of pixels that it may meet."""
    ax, ay, dx, dy = out[AX, i], out[AY, i], out[DX, i], out[DY, i]
    wx, wy, ex, ey = out[WX, i], out[WY, i], out[EX, i], out[EY, i]
    across_x, across_y = TWO * wx + ex, TWO * wy + ey
    along, across = _norm(dx, dy), _norm(across_x, across_y)
    if not min(along, across) > ZERO:
        out[LOW, i], out[HIGH, i] = ONE, ZERO
        return
    if limb[SPHERE] > ZERO:
        radius, y = HALF * _norm(dx + across_x, dy + across_y) + rim_px, ay + HALF * dy
        out[OUTLINE, i], out[OUTLINE + 1, i], out[OUTLINE + 2, i] = ax + HALF * dx, y, radius
        low, high = y - radius, y + radius
    else:
        ux, uy, vx, vy = dx / along, dy / along, across_x / across, across_y / across
        side, low, high = ONE if dx * across_y - dy * across_x > ZERO else -ONE, _FAR, -_FAR
        for k in range(4):
            u, v = ONE if k == 1 or k == 2 else ZERO, side if k >= 2 else -side
            forth, aside = rim_px * (TWO * u - ONE), rim_px * v
            x = ax + u * dx + v * (wx + u * ex) + forth * ux + aside * vx
            y = ay + u * dy + v * (wy + u * ey) + forth * uy + aside * vy
            out[OUTLINE + 2 * k, i], out[OUTLINE + 2 * k + 1, i] = x, y
            low, high = min(low, y), max(high, y)
        for k in range(4):
            this, other = OUTLINE + 2 * k, OUTLINE + 2 * ((k + 1) % 4)
            rise = out[other + 1, i] - out[this + 1, i]
            rise = max(rise, _LEAST_RISE) if rise > ZERO else min(rise, -_LEAST_RISE)
            out[SLOPES + k, i] = (out[other, i] - out[this, i]) / rise
    out[LOW, i] = np.float32(math.ceil(min(max(low, -_SCREEN), _SCREEN)))
    out[HIGH, i] = np.float32(math.floor(min(max(high, -_SCREEN), _SCREEN)))


@device
def _project(camera: Any, point: Any) -> Any:
    k1, k2, k3 = camera[DISTORTION], camera[DISTORTION + 1], camera[DISTORTION + 4]
    p1, p2 = camera[DISTORTION + 2], camera[DISTORTION + 3]
    depth = max(point[2], _NEAR)  # a patch that is nearer is not used
    x, y = point[0] / depth, point[1] / depth
    r2 = x * x + y * y
    radial = ONE + r2 * (k1 + r2 * (k2 + r2 * k3))
    bent_x = x * radial + TWO * p1 * x * y + p2 * (r2 + TWO * x * x)
    bent_y = y * radial + p1 * (r2 + TWO * y * y) + TWO * p2 * x * y
    return camera[CENTRE] + camera[FOCAL] * bent_x, camera[CENTRE + 1] + camera[FOCAL + 1] * bent_y


@device
def _seen(camera: Any, frame: Any, column: Any, i: Any) -> Any:
    """An axis of a joint's frame, turned into the camera's."""
    v = frame[column, i], frame[3 + column, i], frame[6 + column, i]
    return _turned(camera, v)


@device
def _seen_place(camera: Any, frame: Any, i: Any) -> Any:
    at = _turned(camera, _row(frame, POSITION, i))
    return at[0] + camera[TRANSLATION], at[1] + camera[TRANSLATION + 1], at[2] + camera[TRANSLATION + 2]


@device
def _turned(camera: Any, v: Any) -> Any:
    a, b = (camera[0], camera[1], camera[2]), (camera[3], camera[4], camera[5])
    return _dot(a, v), _dot(b, v), _dot((camera[6], camera[7], camera[8]), v)


@device
def _along(x_axis: Any, y_axis: Any, z_axis: Any, origin: Any, limb: Any, at: Any) -> Any:
    return _add(_add(_add(origin, limb[at], x_axis), limb[at + 1], y_axis), limb[at + 2], z_axis)


@device
def _row(frame: Any, row: Any, i: Any) -> Any:
    return frame[row, i], frame[row + 1, i], frame[row + 2, i]


@device
def _times(a: Any, u: Any, v: Any, w: Any) -> Any:
    return _dot(a, u), _dot(a, v), _dot(a, w)


@device
def _dot(a: Any, b: Any) -> Any:
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


@device
def _add(p: Any, length: Any, direction: Any) -> Any:
    return p[0] + length * direction[0], p[1] + length * direction[1], p[2] + length * direction[2]


@device
def _cross(a: Any, b: Any) -> Any:
    return a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]


@device
def _unit(a: Any) -> Any:
    scale = ONE / max(math.sqrt(_dot(a, a)), _TINY)
    return a[0] * scale, a[1] * scale, a[2] * scale


@device
def _norm(x: Any, y: Any) -> Any:
    return math.sqrt(x * x + y * y)
