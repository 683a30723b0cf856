"""The fused kernels of the implicit surface: what `surface_reference` defines, for one pose and K points.

Every degree of freedom moves the joints below it along a screw: turning about the world axis w through o, or shifting
along v, with v = o × w for a turn. Seen from the body, a point X held in the world moves the other way, so a residual
with the gradient g at X changes by −(w · (X × g) + v · g). The screws that move a joint stand in one table a joint,
with zeros for the others: a row of the Jacobian is one pass over contiguous memory, without a branch.
"""

import math
from typing import Any

import numba
import numpy as np

# Every reordering that keeps NaN and infinity meaningful. With NumPy's error model a division does not branch.
FAST = {"reassoc", "contract", "nsz", "arcp"}
FIELD, DISTANCE = 0, 1
MARGIN = 1e-9
"""Bounds may be above the nearest by this part, so that rounding never hides a part."""
NEGLIGIBLE = -40.0
"""log(f_i / f) below which an ellipsoid's share is zero to double precision."""

# Columns of the ellipsoids' table on their joints, and in the world: the centre, the axes (rows of three), 1 / half
# size² along each, and the largest of these.
CENTRE, AXES, INVERSE, STEEPEST = 0, 3, 12, 15
N_COLUMNS = 16
# Columns of the work space, a row for each ellipsoid of a part: the point in the ellipsoid's axes, its algebraic
# distance, its share in the part's field, the metres per unit of normalised radius and their derivatives with respect
# to d, n and m of `_scale`.
Y, D, SHARE, SCALE, SCALE_D, SCALE_N, SCALE_M = 0, 3, 4, 5, 6, 7, 8
N_TERMS = 9


@numba.njit(cache=True, nogil=True, error_model="numpy", fastmath=FAST)
def attach(
    table: Any, joints: Any, parts: Any, sharpness: float, kind: int, rotations: Any, positions: Any,
    points: Any, attachment: Any,
) -> None:  # fmt: skip
    """attachment (K,): the part with the smallest |log(f / C)| or |pseudo-distance|; the first of equals.

    Only parts whose lower bound allows it are weighed: a part's scale is never below its smallest half size.
    """
    world = np.empty_like(table)
    _to_world(table, joints, rotations, positions, world)
    n_parts = parts.shape[0] - 1
    terms, least = np.empty((table.shape[0], N_TERMS)), np.empty(n_parts)
    most, thinnest = np.empty(n_parts), np.empty(n_parts)
    for part in range(n_parts):
        most[part] = math.log(parts[part + 1] - parts[part])
        thinnest[part] = 1.0 / math.sqrt(table[parts[part] : parts[part + 1], STEEPEST].max())
    for k in range(points.shape[0]):
        x, y, z = points[k, 0], points[k, 1], points[k, 2]
        likely = 0
        for part in range(n_parts):
            log_field = min(0.0, most[part] + _largest(world, parts[part], parts[part + 1], x, y, z, sharpness))
            least[part] = -log_field if kind == FIELD else thinnest[part] * _steps(log_field, sharpness)
            if least[part] < least[likely]:
                likely = part
        nearest = _away(world, parts[likely], parts[likely + 1], x, y, z, sharpness, kind, terms)
        attachment[k] = likely
        for part in range(n_parts):
            if part != likely and least[part] <= nearest * (1.0 + MARGIN):
                away = _away(world, parts[part], parts[part + 1], x, y, z, sharpness, kind, terms)
                if away < nearest or (away == nearest and part < attachment[k]):
                    nearest = away
                    attachment[k] = part


@numba.njit(cache=True, nogil=True, error_model="numpy", fastmath=FAST)
def residuals(
    pose: Any, parents: Any, offsets: Any, dof_joints: Any, dof_axes: Any,
    table: Any, joints: Any, parts: Any, sharpness: float, level: float, kind: int,
    points: Any, attachment: Any, found: Any,
) -> None:  # fmt: skip
    """found (K,): the residuals of points attached to parts."""
    screws = np.empty((0, 6, 0))
    world = _posed(pose, parents, offsets, dof_joints, dof_axes, table, joints, screws)
    terms = np.empty((table.shape[0], N_TERMS))
    for k in range(points.shape[0]):
        low, high = parts[attachment[k]], parts[attachment[k] + 1]
        log_field = _log_field(world, low, high, points[k, 0], points[k, 1], points[k, 2], sharpness, terms)
        if kind == FIELD:
            found[k] = level * math.expm1(log_field)
        else:
            found[k] = _steps(log_field, sharpness) * _part_scale(world, low, high, terms)


@numba.njit(cache=True, nogil=True, error_model="numpy", fastmath=FAST)
def residual_jacobian(
    pose: Any, parents: Any, offsets: Any, dof_joints: Any, dof_axes: Any,
    table: Any, joints: Any, parts: Any, sharpness: float, level: float, kind: int,
    points: Any, attachment: Any, found: Any, jacobian: Any,
) -> None:  # fmt: skip
    """found (K,) as `residuals`, and jacobian (K, P) with respect to the pose."""
    screws = np.zeros((parents.shape[0], 6, pose.shape[0]))
    world = _posed(pose, parents, offsets, dof_joints, dof_axes, table, joints, screws)
    terms = np.empty((table.shape[0], N_TERMS))
    gradient = np.empty(3)
    for k in range(points.shape[0]):
        x, y, z = points[k, 0], points[k, 1], points[k, 2]
        low, high = parts[attachment[k]], parts[attachment[k] + 1]
        log_field = _log_field(world, low, high, x, y, z, sharpness, terms)
        if kind == FIELD:
            ratio = level * math.exp(log_field)
            found[k] = level * math.expm1(log_field)
            steps, slope, scale = 0.0, ratio, 1.0
        else:
            steps, slope = _steps(log_field, sharpness), _slope(log_field, sharpness)
            scale = _part_scale(world, low, high, terms)
            found[k] = steps * scale
        gradient[:] = 0.0
        first = True
        for i in range(low, high):
            _add_gradient(world, i, terms, i - low, sharpness, kind, steps, slope, scale, gradient)
            if i + 1 == high or joints[i + 1] != joints[i]:
                _add_row(screws, joints[i], x, y, z, gradient, first, jacobian, k)
                gradient[:] = 0.0
                first = False


@numba.njit(cache=True, nogil=True, error_model="numpy", fastmath=FAST)
def _away(
    world: Any, low: int, high: int, x: float, y: float, z: float, sharpness: float, kind: int, terms: Any
) -> float:
    """|log(f / C)| or |pseudo-distance| of one part at a point."""
    log_field = _log_field(world, low, high, x, y, z, sharpness, terms)
    if kind == FIELD:
        return abs(log_field)
    return abs(_steps(log_field, sharpness) * _part_scale(world, low, high, terms))


@numba.njit(cache=True, nogil=True, error_model="numpy", fastmath=FAST)
def _largest(world: Any, low: int, high: int, x: float, y: float, z: float, sharpness: float) -> float:
    """The largest log(f_i / C) in one part at a point: log(f / C) is above it by log n at most."""
    d = np.inf
    for i in range(low, high):
        ax, ay, az = x - world[i, CENTRE], y - world[i, CENTRE + 1], z - world[i, CENTRE + 2]
        here = 0.0
        for axis in range(3):
            m = AXES + 3 * axis
            along = world[i, m] * ax + world[i, m + 1] * ay + world[i, m + 2] * az
            here += along * along * world[i, INVERSE + axis]
        d = min(d, here)
    return sharpness * (1.0 - d)


@numba.njit(cache=True, nogil=True, error_model="numpy", fastmath=FAST)
def _log_field(world: Any, low: int, high: int, x: float, y: float, z: float, sharpness: float, terms: Any) -> float:
    """log(f / C) of one part at a point; fills Y, D and SHARE."""
    top = -np.inf
    for i in range(low, high):
        row = i - low
        ax, ay, az = x - world[i, CENTRE], y - world[i, CENTRE + 1], z - world[i, CENTRE + 2]
        d = 0.0
        for axis in range(3):
            m = AXES + 3 * axis
            along = world[i, m] * ax + world[i, m + 1] * ay + world[i, m + 2] * az
            terms[row, Y + axis] = along
            d += along * along * world[i, INVERSE + axis]
        terms[row, D] = d
        top = max(top, sharpness * (1.0 - d))
    if high == low + 1:
        terms[0, SHARE] = 1.0
        return top
    total = 0.0
    for row in range(high - low):
        exponent = sharpness * (1.0 - terms[row, D]) - top
        terms[row, SHARE] = math.exp(exponent) if exponent > NEGLIGIBLE else 0.0
        total += terms[row, SHARE]
    for row in range(high - low):
        terms[row, SHARE] /= total
    return top + math.log(total)


@numba.njit(cache=True, nogil=True, error_model="numpy", fastmath=FAST)
def _steps(log_field: float, sharpness: float) -> float:
    """How far the part's normalised radius is above 1."""
    if log_field > 0.0:
        return -0.5 * log_field / sharpness
    return math.sqrt(1.0 - log_field / sharpness) - 1.0


@numba.njit(cache=True, nogil=True, error_model="numpy", fastmath=FAST)
def _slope(log_field: float, sharpness: float) -> float:
    """Derivative of `_steps` with respect to log(f / C)."""
    if log_field > 0.0:
        return -0.5 / sharpness
    return -0.5 / (sharpness * math.sqrt(1.0 - log_field / sharpness))


@numba.njit(cache=True, nogil=True, error_model="numpy", fastmath=FAST)
def _part_scale(world: Any, low: int, high: int, terms: Any) -> float:
    """Metres per unit of the part's normalised radius; fills SCALE and its derivatives."""
    scale = 0.0
    for i in range(low, high):
        if terms[i - low, SHARE] > 0.0:
            scale += terms[i - low, SHARE] * _scale(world, i, terms, i - low)
    return scale


@numba.njit(cache=True, nogil=True, error_model="numpy", fastmath=FAST)
def _scale(world: Any, i: int, terms: Any, row: int) -> float:
    """Metres per unit of one ellipsoid's normalised radius; d = Σ (y/h)², n = Σ y²/h⁴, m = Σ y²."""
    d, n, m = terms[row, D], 0.0, 0.0
    for axis in range(3):
        square, inverse = terms[row, Y + axis] ** 2, world[i, INVERSE + axis]
        n += square * inverse * inverse
        m += square
    inside = max(0.0, 1.0 - d)
    steepest = world[i, STEEPEST]
    below = n + inside * inside * steepest
    near = math.sqrt((d + inside * inside) / below)
    near_d = (1.0 - 2.0 * inside + 2.0 * near * near * inside * steepest) / (2.0 * near * below)
    near_n = -0.5 * near / below
    scale: float = near
    scale_d, scale_n, scale_m = near_d, near_n, 0.0
    if d > 1.0:
        radius = math.sqrt(d)
        far = math.sqrt(m) / radius
        beyond = 1.0 - 1.0 / radius
        weight = beyond * beyond
        scale = near + weight * (far - near)
        scale_d = (1.0 - weight) * near_d - weight * 0.5 * far / d + (far - near) * beyond / (radius * d)
        scale_n = (1.0 - weight) * near_n
        scale_m = weight * 0.5 * far / m
    terms[row, SCALE], terms[row, SCALE_D], terms[row, SCALE_N], terms[row, SCALE_M] = scale, scale_d, scale_n, scale_m
    return scale


@numba.njit(cache=True, nogil=True, error_model="numpy", fastmath=FAST)
def _add_gradient(
    world: Any, i: int, terms: Any, row: int, sharpness: float, kind: int,
    steps: float, slope: float, scale: float, gradient: Any,
) -> None:  # fmt: skip
    """Add what ellipsoid i contributes to the residual's gradient with respect to the point, in the world's axes."""
    share = terms[row, SHARE]
    if share == 0.0:
        return
    by_d, by_n, by_m = -sharpness * share * slope * scale, 0.0, 0.0
    if kind == DISTANCE:
        by_d += share * steps * (terms[row, SCALE_D] - sharpness * (terms[row, SCALE] - scale))
        by_n = share * steps * terms[row, SCALE_N]
        by_m = share * steps * terms[row, SCALE_M]
    for axis in range(3):
        inverse = world[i, INVERSE + axis]
        along = 2.0 * terms[row, Y + axis] * (by_m + inverse * (by_d + inverse * by_n))
        for a in range(3):
            gradient[a] += along * world[i, AXES + 3 * axis + a]


@numba.njit(cache=True, nogil=True, error_model="numpy", fastmath=FAST)
def _add_row(
    screws: Any, joint: int, x: float, y: float, z: float, gradient: Any, first: bool, jacobian: Any, k: int
) -> None:
    """Add −(w · (X × g) + v · g) for the screws of a joint to row k, or write it if it is the first."""
    g0, g1, g2 = gradient[0], gradient[1], gradient[2]
    t0, t1, t2 = y * g2 - z * g1, z * g0 - x * g2, x * g1 - y * g0
    if first:
        for p in range(jacobian.shape[1]):
            jacobian[k, p] = -(
                screws[joint, 0, p] * t0 + screws[joint, 1, p] * t1 + screws[joint, 2, p] * t2
                + screws[joint, 3, p] * g0 + screws[joint, 4, p] * g1 + screws[joint, 5, p] * g2
            )  # fmt: skip
    else:
        for p in range(jacobian.shape[1]):
            jacobian[k, p] -= (
                screws[joint, 0, p] * t0 + screws[joint, 1, p] * t1 + screws[joint, 2, p] * t2
                + screws[joint, 3, p] * g0 + screws[joint, 4, p] * g1 + screws[joint, 5, p] * g2
            )  # fmt: skip


@numba.njit(cache=True, nogil=True, error_model="numpy", fastmath=FAST)
def _posed(
    pose: Any, parents: Any, offsets: Any, dof_joints: Any, dof_axes: Any, table: Any, joints: Any, screws: Any
) -> Any:
    """The ellipsoids' table in the world; fills screws (J, 6, P) unless it is empty."""
    rotations, positions = np.empty((parents.shape[0], 3, 3)), np.empty((parents.shape[0], 3))
    _forward(pose, parents, offsets, dof_joints, dof_axes, rotations, positions, screws)
    world = np.empty_like(table)
    _to_world(table, joints, rotations, positions, world)
    return world


@numba.njit(cache=True, nogil=True, error_model="numpy", fastmath=FAST)
def _to_world(table: Any, joints: Any, rotations: Any, positions: Any, world: Any) -> None:
    for i in range(table.shape[0]):
        joint = joints[i]
        for a in range(3):
            place = positions[joint, a]
            for b in range(3):
                place += rotations[joint, a, b] * table[i, CENTRE + b]
            world[i, CENTRE + a] = place
            for axis in range(3):
                m = AXES + 3 * axis
                world[i, m + a] = (
                    rotations[joint, a, 0] * table[i, m]
                    + rotations[joint, a, 1] * table[i, m + 1]
                    + rotations[joint, a, 2] * table[i, m + 2]
                )
        for c in range(INVERSE, N_COLUMNS):
            world[i, c] = table[i, c]


@numba.njit(cache=True, nogil=True, error_model="numpy", fastmath=FAST)
def _forward(
    pose: Any, parents: Any, offsets: Any, dof_joints: Any, dof_axes: Any, rotations: Any, positions: Any, screws: Any
) -> None:
    """Joint frames as `kinematics.forward` of one pose, and each joint's screws on the way."""
    n_dofs, with_screws, p = pose.shape[0], screws.shape[0] > 0, 3
    for j in range(parents.shape[0]):
        parent = parents[j]
        for a in range(3):
            positions[j, a] = pose[a]
            for b in range(3):
                rotations[j, a, b] = 1.0 if a == b else 0.0
        if parent >= 0:
            for a in range(3):
                place = positions[parent, a]
                for b in range(3):
                    rotations[j, a, b] = rotations[parent, a, b]
                    place += rotations[parent, a, b] * offsets[j, b]
                positions[j, a] = place
        if with_screws:
            _first_screws(j, parent, p, dof_axes, screws)
        while p < n_dofs and dof_joints[p] == j:
            if with_screws:
                _add_screw(j, p, dof_axes, rotations, positions, screws)
            _turn(rotations, j, dof_axes[p, 0], dof_axes[p, 1], dof_axes[p, 2], math.sin(pose[p]), math.cos(pose[p]))
            p += 1


@numba.njit(cache=True, nogil=True, error_model="numpy", fastmath=FAST)
def _first_screws(j: int, parent: int, p: int, dof_axes: Any, screws: Any) -> None:
    """The screws that move a joint's parent move the joint too; the root's are the translations."""
    if parent >= 0:
        for c in range(6):
            for q in range(p):
                screws[j, c, q] = screws[parent, c, q]
    else:
        for q in range(3):
            for a in range(3):
                screws[j, 3 + a, q] = dof_axes[q, a]


@numba.njit(cache=True, nogil=True, error_model="numpy", fastmath=FAST)
def _add_screw(j: int, p: int, dof_axes: Any, rotations: Any, positions: Any, screws: Any) -> None:
    """Degree of freedom p turns joint j, whose frame the turns before p have turned so far."""
    for a in range(3):
        screws[j, a, p] = (
            rotations[j, a, 0] * dof_axes[p, 0]
            + rotations[j, a, 1] * dof_axes[p, 1]
            + rotations[j, a, 2] * dof_axes[p, 2]
        )
    w0, w1, w2 = screws[j, 0, p], screws[j, 1, p], screws[j, 2, p]
    o0, o1, o2 = positions[j, 0], positions[j, 1], positions[j, 2]
    screws[j, 3, p], screws[j, 4, p], screws[j, 5, p] = o1 * w2 - o2 * w1, o2 * w0 - o0 * w2, o0 * w1 - o1 * w0


@numba.njit(cache=True, nogil=True, error_model="numpy", fastmath=FAST)
def _turn(rotations: Any, j: int, x: float, y: float, z: float, s: float, c: float) -> None:
    """Multiply joint j's frame by the rotation about a unit axis with sine s and cosine c (Rodrigues' formula)."""
    t = 1.0 - c
    for a in range(3):
        r0, r1, r2 = rotations[j, a, 0], rotations[j, a, 1], rotations[j, a, 2]
        rotations[j, a, 0] = r0 * (c + t * x * x) + r1 * (t * x * y + s * z) + r2 * (t * x * z - s * y)
        rotations[j, a, 1] = r0 * (t * x * y - s * z) + r1 * (c + t * y * y) + r2 * (t * y * z + s * x)
        rotations[j, a, 2] = r0 * (t * x * z + s * y) + r1 * (t * y * z - s * x) + r2 * (c + t * z * z)
