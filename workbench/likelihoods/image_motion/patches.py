"""The limbs' planar patches in kernels, LANES particles at once: their projections, cover and occlusion.

`limb_patches`, `inside_image` and `hidden_samples` of `tests/oracles/image_motion.py` define them. Both use float64, so
that they agree on the side of an edge on which a point lies. Rows and lanes: see `workbench.body.simd_kinematics`.
"""

from typing import Any

import numpy as np

from workbench.body.simd_kinematics import LANES, POSITION, inlined

MIN_DEPTH = 1e-3  # minimum depth, m, of a patch's corners; otherwise it is not compared
MIN_SINE = 1e-3  # minimum angle, rad, between limb and line of sight; otherwise it has no patch
MIN_AREA = 1e-6  # minimum projected area, about, px², of a patch that covers other limbs

OUTSIDE, HIDDEN = 1, 2

# Columns of the limbs' table: ends of the axis, semi-axes of the section at both ends, whether a sphere, mean radius;
# and of every limb whether it is connected.
START, END, START_RADII, END_RADII, SPHERE, THICKNESS, CONNECTED = 0, 3, 6, 8, 10, 11, 12
# A camera: its rotation row by row, translation, fx, fy, cx, cy, k1, k2, p1, p2, k3.
TRANSLATION, FOCAL, CENTRE, DISTORTION = 9, 12, 14, 16
# Rows of a patch: (AX + u DX) + v (WX + u EX) in x, the same in y, and Z + u DZ in depth; u = 0..1 along, v = −1..1
# across. ACROSS: x and y, in the joint's frame, of the direction in which v grows. COSINE: cos α, 0 without a patch.
AX, DX, WX, EX, AY, _, _, _, Z, DZ, ACROSS, _, COSINE, PATCH = range(0, 14 * LANES, LANES)
# Rows of a limb's cover: u and v of a pixel by an affine map, |v| <= H + u DH for a patch; the depth of its nearest
# surface; its bounding box, empty (left > right) if it covers nothing.
UX, UY, U0, VX, VY, V0, H, DH, SURFACE, LEFT, RIGHT, TOP, BOTTOM, COVER = range(0, 14 * LANES, LANES)
# Rows of one limb's points in another's coordinates: s = S + u SU + v SV + uv SE along it and t likewise across it,
# half its width there W + s WS, and whether its axis is nearer, D + s DS < u DU.
S, SU, SV, SE, T, TU, TV, TE, W, WS, D, DS, DU, PAIR = range(0, 14 * LANES, LANES)


@inlined
def patch(limb: Any, camera: Any, frame: Any, out: Any) -> None:
    """Write a limb's patch (PATCH,), given its row of the table and its joint's frame. See `limb_patches`."""
    sphere, radius = limb[SPHERE] > 0.0, limb[START_RADII] / np.sqrt(2.0)
    start_at, end_at = (limb[START], limb[START + 1], limb[START + 2]), (limb[END], limb[END + 1], limb[END + 2])
    sa, sb, ea, eb = limb[START_RADII], limb[START_RADII + 1], limb[END_RADII], limb[END_RADII + 1]
    rotation = (camera[0], camera[1], camera[2]), (camera[3], camera[4], camera[5]), (camera[6], camera[7], camera[8])
    translation = camera[TRANSLATION], camera[TRANSLATION + 1], camera[TRANSLATION + 2]
    fx, fy, cx, cy = camera[FOCAL], camera[FOCAL + 1], camera[CENTRE], camera[CENTRE + 1]
    k1, k2, k3 = camera[DISTORTION], camera[DISTORTION + 1], camera[DISTORTION + 4]
    lens = fx, fy, cx, cy, k1, k2, k3, camera[DISTORTION + 2], camera[DISTORTION + 3]
    for i in range(LANES):
        x_axis = _rotate(rotation, frame[i], frame[i + 3 * LANES], frame[i + 6 * LANES])
        y_axis = _rotate(rotation, frame[i + LANES], frame[i + 4 * LANES], frame[i + 7 * LANES])
        z_axis = _rotate(rotation, frame[i + 2 * LANES], frame[i + 5 * LANES], frame[i + 8 * LANES])
        x, y, z = frame[i + POSITION], frame[i + POSITION + LANES], frame[i + POSITION + 2 * LANES]
        origin = _add(_rotate(rotation, x, y, z), 1.0, translation)
        start = _place(x_axis, y_axis, z_axis, origin, start_at)
        end = _place(x_axis, y_axis, z_axis, origin, end_at)
        axis = z_axis if sphere else _unit(_add(end, -1.0, start))
        line_of_sight = _add(start, 1.0, end)
        across = _cross(line_of_sight, axis)
        usable = _dot(across, across) > MIN_SINE * MIN_SINE * _dot(line_of_sight, line_of_sight)
        across = _unit(across)
        x, y = _dot(x_axis, across), _dot(y_axis, across)
        start_width, end_width = _norm(sa * x, sb * y), _norm(ea * x, eb * y)
        cos_alpha = _norm(axis[0], axis[1])
        if sphere:
            cos_alpha = 1.0
            start_width = end_width = radius
            upright = _cross(across, _unit(line_of_sight))
            start, end = _add(start, -start_width, upright), _add(end, end_width, upright)
        a, b = _add(start, -start_width, across), _add(start, start_width, across)
        c, d = _add(end, -end_width, across), _add(end, end_width, across)
        usable &= (a[2] > MIN_DEPTH) & (b[2] > MIN_DEPTH) & (c[2] > MIN_DEPTH) & (d[2] > MIN_DEPTH)
        (ax, ay), (bx, by) = _project(lens, a), _project(lens, b)
        (cx, cy), (dx, dy) = _project(lens, c), _project(lens, d)
        _write(out, i + AX, ax, bx, cx, dx, usable)
        _write(out, i + AY, ay, by, cy, dy, usable)
        out[i + Z], out[i + DZ] = start[2], end[2] - start[2]
        out[i + ACROSS], out[i + ACROSS + LANES] = x, y
        out[i + COSINE] = cos_alpha if usable else 0.0


@inlined
def _write(out: Any, i: int, a: float, b: float, c: float, d: float, usable: bool) -> None:
    """Write one coordinate of the patch with the corners a, b at its start and c, d at its end. A limb without a patch
    gets one at the image's corner, so that all numbers are in range."""
    out[i], out[i + DX] = (a + b) / 2.0 if usable else 0.0, (c + d - a - b) / 2.0 if usable else 0.0
    out[i + WX], out[i + EX] = (b - a) / 2.0 if usable else 0.0, (d - c - b + a) / 2.0 if usable else 0.0


@inlined
def cover(limb: Any, patch: Any, out: Any, box: Any) -> None:
    """Write a patch's (a sphere's disc's) cover (COVER,): the inverse of its affine part, bounding box, depth; and a
    box (6,) around it in all lanes."""
    sphere, thickness = limb[SPHERE] > 0.0, limb[THICKNESS]
    for i in range(LANES):
        ax, ay, dx, dy = patch[i + AX], patch[i + AY], patch[i + DX], patch[i + AY + DX]
        ex, ey, z0, z1 = patch[i + EX], patch[i + AY + EX], patch[i + Z], patch[i + Z] + patch[i + DZ]
        wx, wy = patch[i + WX] + ex / 2.0, patch[i + AY + WX] + ey / 2.0  # half the width, in the middle
        area = dx * wy - dy * wx
        covers = (patch[i + COSINE] > 0.0) & (abs(area) > MIN_AREA)
        scale = 1.0 / area if covers else 0.0
        ux, uy, vx, vy = wy * scale, -wx * scale, -dy * scale, dx * scale
        out[i + UX], out[i + UY], out[i + U0] = ux, uy, -(ux * ax + uy * ay) if covers else np.inf  # u never in 0..1
        out[i + VX], out[i + VY], out[i + V0] = vx, vy, -(vx * ax + vy * ay)
        half = _norm(wx, wy)
        per_half = 1.0 / half if covers else 0.0
        start_width = _norm(wx - ex / 2.0, wy - ey / 2.0) * per_half
        end_width = _norm(wx + ex / 2.0, wy + ey / 2.0) * per_half
        out[i + H], out[i + DH] = start_width, end_width - start_width
        widest = max(start_width, end_width)
        reach_x, reach_y = abs(dx) / 2.0 + widest * abs(wx), abs(dy) / 2.0 + widest * abs(wy)
        if sphere:
            reach_x, reach_y = np.sqrt(2.0) * _norm(dx / 2.0, wx), np.sqrt(2.0) * _norm(dy / 2.0, wy)
        out[i + LEFT] = ax + dx / 2.0 - reach_x if covers else np.inf
        out[i + RIGHT] = ax + dx / 2.0 + reach_x if covers else -np.inf
        out[i + TOP], out[i + BOTTOM] = ay + dy / 2.0 - reach_y, ay + dy / 2.0 + reach_y
        out[i + SURFACE] = min(z0, z1) - thickness
    _widen(patch, out, box)


@inlined
def _widen(patch: Any, covers: Any, box: Any) -> None:
    """Write the box (6,) around the limb in all lanes: left, right, top, bottom, smallest and largest depth of its
    axis."""
    left, top, low, right, bottom, high = np.inf, np.inf, np.inf, -np.inf, -np.inf, -np.inf
    for i in range(LANES):
        if covers[i + LEFT] <= covers[i + RIGHT]:
            left, right = min(left, covers[i + LEFT]), max(right, covers[i + RIGHT])
            top, bottom = min(top, covers[i + TOP]), max(bottom, covers[i + BOTTOM])
            start, end = patch[i + Z], patch[i + Z] + patch[i + DZ]
            low, high = min(low, min(start, end)), max(high, max(start, end))
    box[0], box[1], box[2], box[3], box[4], box[5] = left, right, top, bottom, low, high


@inlined
def flag_outside(patch: Any, samples: Any, width: float, height: float, flags: Any) -> None:
    """Flag the points of a patch that are not between the centres of the image's pixels. samples: (2, n), u and v.
    flags: (n · LANES,) int32, n rows, the bits OUTSIDE and HIDDEN of excluded points."""
    right, bottom = width - 1.0, height - 1.0
    for k in range(samples.shape[1]):
        u, v = samples[0, k], samples[1, k]
        for i in range(LANES):
            x, y = place(patch, i, u, v)
            inside = (x >= 0.0) & (x < right) & (y >= 0.0) & (y < bottom)
            flags[k * LANES + i] |= 0 if inside else OUTSIDE


@inlined
def flag_hidden(
    table: Any, limb: int, samples: Any, patches: Any, covers: Any, boxes: Any, whole_limb: bool, pair: Any, flags: Any
) -> bool:
    """Flag the points of a limb that other limbs hide, see `hidden_samples`; return whether any may be hidden.
    whole_limb: the occlusion "limb", else "sample". pair: (PAIR,), overwritten. flags: as in `flag_outside`."""
    any_near, span = False, _span(samples)
    for k in range(covers.shape[0]):
        margin, sphere = (table[limb, THICKNESS] + table[k, THICKNESS]) / 2.0, table[k, SPHERE] > 0.0
        ahead = table[limb, CONNECTED + k] == 0.0 if whole_limb else boxes[k, 4] + margin < boxes[limb, 5]
        across = boxes[k, 0] <= boxes[limb, 1] and boxes[k, 1] >= boxes[limb, 0]
        if k != limb and ahead and across and boxes[k, 2] <= boxes[limb, 3] and boxes[k, 3] >= boxes[limb, 2]:
            _pair(patches[limb], patches[k], covers[k], margin, sphere, pair)
            if whole_limb:
                for i in range(LANES):
                    nearer = covers[k, i + SURFACE] < covers[limb, i + SURFACE]
                    pair[i + D], pair[i + DS], pair[i + DU] = -np.inf if nearer else np.inf, 0.0, 0.0
            if _may_hide(span, pair, sphere):
                _flag_covered(samples, pair, sphere, flags)
                any_near = True
    if whole_limb:
        for k in range(1, samples.shape[1]):
            for i in range(LANES):
                flags[i] |= flags[k * LANES + i] & HIDDEN
        for k in range(1, samples.shape[1]):
            for i in range(LANES):
                flags[k * LANES + i] |= flags[i] & HIDDEN
    return any_near


@inlined
def flag_covered(table: Any, limb: int, samples: Any, patches: Any, covers: Any, pair: Any, flags: Any) -> None:
    """Flag the points around a limb that any limb covers, including itself, at any depth."""
    span = _span(samples)
    for k in range(covers.shape[0]):
        sphere = table[k, SPHERE] > 0.0
        _pair(patches[limb], patches[k], covers[k], 0.0, sphere, pair)
        for i in range(LANES):
            pair[i + D], pair[i + DS], pair[i + DU] = -np.inf, 0.0, 0.0
        if _may_hide(span, pair, sphere):
            _flag_covered(samples, pair, sphere, flags)


@inlined
def _span(samples: Any) -> tuple[float, float, float, float]:
    """Return the smallest and largest u and v."""
    u0, u1, v0, v1 = np.inf, -np.inf, np.inf, -np.inf
    for k in range(samples.shape[1]):
        u0, u1 = min(u0, samples[0, k]), max(u1, samples[0, k])
        v0, v1 = min(v0, samples[1, k]), max(v1, samples[1, k])
    return u0, u1, v0, v1


@inlined
def _pair(limb: Any, other: Any, covers: Any, margin: float, sphere: bool, out: Any) -> None:
    """Write the map from a limb's (u, v) to another limb's coordinates: one map instead of two."""
    for i in range(LANES):
        ax, dx, wx, ex = limb[i + AX], limb[i + DX], limb[i + WX], limb[i + EX]
        ay, dy, wy, ey = limb[i + AY], limb[i + AY + DX], limb[i + AY + WX], limb[i + AY + EX]
        ux, uy, vx, vy = covers[i + UX], covers[i + UY], covers[i + VX], covers[i + VY]
        out[i + S], out[i + SU] = covers[i + U0] + ux * ax + uy * ay, ux * dx + uy * dy
        out[i + SV], out[i + SE] = ux * wx + uy * wy, ux * ex + uy * ey
        out[i + T], out[i + TU] = covers[i + V0] + vx * ax + vy * ay, vx * dx + vy * dy
        out[i + TV], out[i + TE] = vx * wx + vy * wy, vx * ex + vy * ey
        out[i + W], out[i + WS] = covers[i + H], covers[i + DH]
        z, dz = other[i + Z] + margin - limb[i + Z], other[i + DZ]
        out[i + D], out[i + DS] = z + 0.5 * dz if sphere else z, 0.0 if sphere else dz
        out[i + DU] = limb[i + DZ]


@inlined
def _may_hide(span: Any, pair: Any, sphere: bool) -> bool:
    """Return False if the other limb hides no point, because it is next to the limb or behind it in all lanes. Every
    quantity is linear in u and in v, so that its extrema are at the corners of the points' range. A disc extends (√2 −
    1) half widths beyond its patch."""
    u0, u1, v0, v1 = span
    beyond = 0.5 if sphere else 0.0
    n = 0
    for i in range(LANES):
        s, su, sv, se = pair[i + S], pair[i + SU], pair[i + SV], pair[i + SE]
        t, tu, tv, te = pair[i + T], pair[i + TU], pair[i + TV], pair[i + TE]
        s0, s1, p0, p1 = s + u0 * su, s + u1 * su, sv + u0 * se, sv + u1 * se
        t0, t1, q0, q1 = t + u0 * tu, t + u1 * tu, tv + u0 * te, tv + u1 * te
        low_s = min(min(s0 + v0 * p0, s0 + v1 * p0), min(s1 + v0 * p1, s1 + v1 * p1))
        high_s = max(max(s0 + v0 * p0, s0 + v1 * p0), max(s1 + v0 * p1, s1 + v1 * p1))
        low_t = min(min(t0 + v0 * q0, t0 + v1 * q0), min(t1 + v0 * q1, t1 + v1 * q1))
        high_t = max(max(t0 + v0 * q0, t0 + v1 * q0), max(t1 + v0 * q1, t1 + v1 * q1))
        widest = max(pair[i + W], pair[i + W] + pair[i + WS])
        meet = (low_s <= 1.0 + beyond) & (high_s >= -beyond) & (low_t <= widest + beyond) & (high_t >= -widest - beyond)
        ahead = pair[i + D] + min(pair[i + DS], 0.0) < max(u0 * pair[i + DU], u1 * pair[i + DU])
        n += 1 if meet & ahead else 0
    return n > 0


@inlined
def _flag_covered(samples: Any, pair: Any, sphere: bool, flags: Any) -> None:
    for k in range(samples.shape[1]):
        a, b, c = samples[0, k], samples[1, k], samples[0, k] * samples[1, k]
        if sphere:
            for i in range(LANES):
                s = 2.0 * (pair[i + S] + a * pair[i + SU] + b * pair[i + SV] + c * pair[i + SE]) - 1.0
                t = pair[i + T] + a * pair[i + TU] + b * pair[i + TV] + c * pair[i + TE]
                covered = (s * s + t * t <= 2.0) & (pair[i + D] < a * pair[i + DU])
                flags[k * LANES + i] |= HIDDEN if covered else 0
        else:
            for i in range(LANES):
                s = pair[i + S] + a * pair[i + SU] + b * pair[i + SV] + c * pair[i + SE]
                t = pair[i + T] + a * pair[i + TU] + b * pair[i + TV] + c * pair[i + TE]
                covered = (s >= 0.0) & (s <= 1.0) & (abs(t) <= pair[i + W] + s * pair[i + WS])
                covered &= pair[i + D] + s * pair[i + DS] < a * pair[i + DU]
                flags[k * LANES + i] |= HIDDEN if covered else 0


@inlined
def place(patch: Any, i: int, u: float, v: float) -> tuple[float, float]:
    """Return the pixel of a point of the patch in lane i."""
    x = patch[i + AX] + u * patch[i + DX] + v * (patch[i + WX] + u * patch[i + EX])
    return x, patch[i + AY] + u * patch[i + AY + DX] + v * (patch[i + AY + WX] + u * patch[i + AY + EX])


@inlined
def _project(lens: Any, point: Any) -> tuple[float, float]:
    """Return the pixel of a point in the camera's frame, as `Camera.project` does."""
    fx, fy, cx, cy, k1, k2, k3, p1, p2 = lens
    per_depth = 1.0 / point[2]
    x, y = point[0] * per_depth, point[1] * per_depth
    r2 = x * x + y * y
    radial = 1.0 + r2 * (k1 + r2 * (k2 + r2 * k3))
    bent_x = x * radial + 2.0 * p1 * x * y + p2 * (r2 + 2.0 * x * x)
    bent_y = y * radial + p1 * (r2 + 2.0 * y * y) + 2.0 * p2 * x * y
    return cx + fx * bent_x, cy + fy * bent_y


@inlined
def _rotate(rows: Any, x: float, y: float, z: float) -> tuple[float, float, float]:
    v = (x, y, z)
    return _dot(rows[0], v), _dot(rows[1], v), _dot(rows[2], v)


@inlined
def _place(x_axis: Any, y_axis: Any, z_axis: Any, origin: Any, at: Any) -> Any:
    return _add(_add(_add(origin, at[0], x_axis), at[1], y_axis), at[2], z_axis)


@inlined
def _add(p: Any, length: float, direction: Any) -> tuple[float, float, float]:
    return p[0] + length * direction[0], p[1] + length * direction[1], p[2] + length * direction[2]


@inlined
def _cross(a: Any, b: Any) -> tuple[float, float, float]:
    return a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]


@inlined
def _dot(a: Any, b: Any) -> Any:
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


@inlined
def _unit(a: Any) -> tuple[float, float, float]:
    scale = 1.0 / max(np.sqrt(_dot(a, a)), 1e-12)
    return a[0] * scale, a[1] * scale, a[2] * scale


@inlined
def _norm(x: float, y: float) -> Any:
    return np.sqrt(x * x + y * y)
