"""The fused kernels of the implicit surface, for K points and one pose, or many; `surface` has the formulas.

Every degree of freedom moves the joints below it along a screw: turning about the world axis w through o, or shifting
along v, with v = o × w for a turn. Seen from the body, a point X held in the world moves the other way, so a residual
with the gradient g at X changes by −(w · (X × g) + v · g). The screws that move a joint stand in one table a joint,
with zeros for the others: a row of the Jacobian is one pass over contiguous memory, without a branch.
"""

import math
from typing import Any

import numpy as np

from workbench.body.simd_kinematics import FAST, inlined
from workbench.utils.kernel_cache import kernel

FIELD, DISTANCE = 0, 1
MARGIN = 1e-9  # bounds may be above the nearest by this part, so that rounding never hides a part
NEGLIGIBLE = -40.0  # log(f_i / f) below which an ellipsoid's share is zero to double precision
POINTS = 32  # points whose lower bounds are computed at once; 16 would be unrolled too early for vector square roots

# Columns of the ellipsoids' table on their joints, and in the world: the centre, the axes over the half sizes (rows of
# three, which take a point to where the ellipsoid is the unit sphere), 1 / half size² and half size² along each, and
# the largest 1 / half size².
CENTRE, AXES, INVERSE, SQUARE, STEEPEST = 0, 3, 12, 15, 18
N_COLUMNS = 19
# Columns of the work space, a row for each ellipsoid of a part: the point where the ellipsoid is the unit sphere, its
# algebraic distance and its share in the part's field.
Q, D, SHARE = 0, 3, 4
N_TERMS = 5


@kernel(error_model="numpy", fastmath=FAST)
def attach(
    table: Any, joints: Any, parts: Any, sharpness: float, kind: int, rotations: Any, positions: Any,
    points: Any, attachment: Any,
) -> None:  # fmt: skip
    """attachment (K,): the part with the smallest |log(f / C)| or |pseudo-distance|; the first of equals."""
    world = np.empty_like(table)
    _to_world(table, joints, rotations, positions, world)
    most, thinnest = _looseness(table, parts)
    least, terms = np.empty((most.shape[0], POINTS)), np.empty((2, table.shape[0], N_TERMS))
    for k in range(points.shape[0]):
        if k % POINTS == 0:
            _lower_bounds(world, parts, most, thinnest, sharpness, kind, points, k, least)
        attachment[k] = _nearest(world, parts, least, k % POINTS, points[k], sharpness, kind, terms)[0]


@kernel(error_model="numpy", fastmath=FAST)
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
        log_field, scale = _weigh(world, low, high, points[k], sharpness, kind, terms)
        found[k] = level * math.expm1(log_field) if kind == FIELD else _steps(log_field, sharpness) * scale


@kernel(error_model="numpy", fastmath=FAST)
def residual_jacobian(
    pose: Any, parents: Any, offsets: Any, dof_joints: Any, dof_axes: Any,
    table: Any, joints: Any, parts: Any, sharpness: float, level: float, kind: int,
    points: Any, attachment: Any, found: Any, jacobian: Any,
) -> None:  # fmt: skip
    """found (K,) as `residuals`, and jacobian (K, P) with respect to the pose."""
    screws = np.zeros((parents.shape[0], 6, pose.shape[0]))
    world = _posed(pose, parents, offsets, dof_joints, dof_axes, table, joints, screws)
    terms = np.empty((table.shape[0], N_TERMS))
    for k in range(points.shape[0]):
        low, high = parts[attachment[k]], parts[attachment[k] + 1]
        log_field, scale = _weigh(world, low, high, points[k], sharpness, kind, terms)
        found[k] = _row(
            world, joints, screws, low, high, points[k], log_field, scale, sharpness, level, kind, terms, jacobian[k]
        )


@kernel(error_model="numpy", fastmath=FAST)
def nearest_residual_jacobian(
    pose: Any, parents: Any, offsets: Any, dof_joints: Any, dof_axes: Any,
    table: Any, joints: Any, parts: Any, sharpness: float, level: float, kind: int,
    points: Any, found: Any, jacobian: Any,
) -> None:  # fmt: skip
    """Compute residuals and derivatives of points attached as by `attach`, whose search has weighed the parts."""
    screws = np.zeros((parents.shape[0], 6, pose.shape[0]))
    world = _posed(pose, parents, offsets, dof_joints, dof_axes, table, joints, screws)
    most, thinnest = _looseness(table, parts)
    least, terms = np.empty((most.shape[0], POINTS)), np.empty((2, table.shape[0], N_TERMS))
    for k in range(points.shape[0]):
        if k % POINTS == 0:
            _lower_bounds(world, parts, most, thinnest, sharpness, kind, points, k, least)
        part, log_field, scale, side = _nearest(world, parts, least, k % POINTS, points[k], sharpness, kind, terms)
        found[k] = _row(
            world, joints, screws, parts[part], parts[part + 1], points[k], log_field, scale, sharpness, level, kind,
            terms[side], jacobian[k],
        )  # fmt: skip


@kernel(error_model="numpy", fastmath=FAST)
def nearest_distances(
    first: int, last: int, poses: Any, parents: Any, offsets: Any, dof_joints: Any, dof_axes: Any,
    table: Any, joints: Any, parts: Any, sharpness: float, points: Any, found: Any,
) -> None:  # fmt: skip
    """found (N, K), rows `first` to `last`: pseudo-distances of points to the nearest part in each of N poses."""
    screws = np.empty((0, 6, 0))
    most, thinnest = _looseness(table, parts)
    least, terms = np.empty((most.shape[0], POINTS)), np.empty((2, table.shape[0], N_TERMS))
    for i in range(first, last):
        world = _posed(poses[i], parents, offsets, dof_joints, dof_axes, table, joints, screws)
        for k in range(points.shape[0]):
            if k % POINTS == 0:
                _lower_bounds(world, parts, most, thinnest, sharpness, DISTANCE, points, k, least)
            _, log_field, scale, _ = _nearest(world, parts, least, k % POINTS, points[k], sharpness, DISTANCE, terms)
            found[i, k] = _steps(log_field, sharpness) * scale


@inlined
def _looseness(table: Any, parts: Any) -> Any:
    """Bound, for each part (B,), by how much log(f / C) may exceed its largest term's, and find the smallest half size,
    below which the part's scale never is."""
    n_parts = parts.shape[0] - 1
    most, thinnest = np.empty(n_parts), np.empty(n_parts)
    for part in range(n_parts):
        most[part] = math.log(parts[part + 1] - parts[part])
        thinnest[part] = 1.0 / math.sqrt(table[parts[part] : parts[part + 1], STEEPEST].max())
    return most, thinnest


@inlined
def _lower_bounds(
    world: Any, parts: Any, most: Any, thinnest: Any, sharpness: float, kind: int, points: Any, first: int, least: Any
) -> None:
    """least (B, POINTS): lower bounds of |log(f / C)| or |pseudo-distance| of POINTS points from `first` on. Innermost
    loops run over points without a branch, so that the compiler makes vector instructions of them."""
    x, y, z = np.empty(POINTS), np.empty(POINTS), np.empty(POINTS)
    for lane in range(POINTS):
        k = min(first + lane, points.shape[0] - 1)
        x[lane], y[lane], z[lane] = points[k, 0], points[k, 1], points[k, 2]
    for part in range(most.shape[0]):
        row = least[part]
        for lane in range(POINTS):
            row[lane] = np.inf
        for i in range(parts[part], parts[part + 1]):
            _nearer(world[i], x, y, z, row)
        loose, thin = most[part], thinnest[part]
        for lane in range(POINTS):
            log_field = min(0.0, loose + sharpness * (1.0 - row[lane]))
            row[lane] = -log_field if kind == FIELD else thin * (np.sqrt(1.0 - log_field / sharpness) - 1.0)


@inlined
def _nearer(ellipsoid: Any, x: Any, y: Any, z: Any, d: Any) -> None:
    """Lower d (POINTS,) to the algebraic distance of an ellipsoid in the world where that is less."""
    c0, c1, c2 = ellipsoid[CENTRE], ellipsoid[CENTRE + 1], ellipsoid[CENTRE + 2]
    a0, a1, a2 = ellipsoid[AXES], ellipsoid[AXES + 1], ellipsoid[AXES + 2]
    b0, b1, b2 = ellipsoid[AXES + 3], ellipsoid[AXES + 4], ellipsoid[AXES + 5]
    e0, e1, e2 = ellipsoid[AXES + 6], ellipsoid[AXES + 7], ellipsoid[AXES + 8]
    for lane in range(POINTS):
        u, v, w = x[lane] - c0, y[lane] - c1, z[lane] - c2
        p, q, r = a0 * u + a1 * v + a2 * w, b0 * u + b1 * v + b2 * w, e0 * u + e1 * v + e2 * w
        d[lane] = min(d[lane], p * p + q * q + r * r)


@inlined
def _nearest(
    world: Any, parts: Any, least: Any, lane: int, point: Any, sharpness: float, kind: int, terms: Any
) -> Any:  # fmt: skip
    """The nearest part of a point, its log(f / C), its scale, and which half of `terms` (2, …) they were weighed in:
    the likeliest is weighed first, and is it where squares overflow; then those as near by their bounds."""
    likely = 0
    for part in range(1, least.shape[0]):
        if least[part, lane] < least[likely, lane]:
            likely = part
    nearest, best, best_field, best_scale, side = np.inf, likely, 0.0, 0.0, 0
    for turn in range(-1, least.shape[0]):
        part = likely if turn < 0 else turn
        if turn == likely or least[part, lane] > nearest * (1.0 + MARGIN):
            continue
        log_field, scale = _weigh(world, parts[part], parts[part + 1], point, sharpness, kind, terms[1 - side])
        away = abs(log_field) if kind == FIELD else abs(_steps(log_field, sharpness) * scale)
        if turn < 0 or away < nearest or (away == nearest and part < best):
            nearest, best, best_field, best_scale, side = away, part, log_field, scale, 1 - side
    return best, best_field, best_scale, side


@inlined
def _row(
    world: Any, joints: Any, screws: Any, low: int, high: int, point: Any, log_field: float, scale: float,
    sharpness: float, level: float, kind: int, terms: Any, row: Any,
) -> Any:  # fmt: skip
    """The residual of a point whose part was weighed; fills its row (P,) of the Jacobian."""
    if kind == FIELD:
        found, steps, slope = level * math.expm1(log_field), 0.0, level * math.exp(log_field)
    else:
        steps, slope = _steps(log_field, sharpness), _slope(log_field, sharpness)
        found = steps * scale
    gradient = (0.0, 0.0, 0.0)
    first = True
    for i in range(low, high):
        gradient = _add_gradient(world[i], terms[i - low], sharpness, kind, steps, slope, scale, gradient)
        if i + 1 == high or joints[i + 1] != joints[i]:
            _add_row(screws[joints[i]], point, gradient, first, row)
            gradient = (0.0, 0.0, 0.0)
            first = False
    return found


@inlined
def _weigh(world: Any, low: int, high: int, point: Any, sharpness: float, kind: int, terms: Any) -> Any:
    """log(f / C) of one part at a point and the part's scale, 1 for the field; fills the part's terms."""
    log_field = _log_field(world, low, high, point, sharpness, terms)
    return log_field, _part_scale(world, low, high, terms) if kind == DISTANCE else 1.0


@inlined
def _log_field(world: Any, low: int, high: int, point: Any, sharpness: float, terms: Any) -> float:
    """log(f / C) of one part at a point; fills the part's terms."""
    top = -np.inf
    for i in range(low, high):
        row = i - low
        x, y, z = point[0] - world[i, CENTRE], point[1] - world[i, CENTRE + 1], point[2] - world[i, CENTRE + 2]
        d = 0.0
        for axis in range(3):
            m = AXES + 3 * axis
            q = world[i, m] * x + world[i, m + 1] * y + world[i, m + 2] * z
            terms[row, Q + axis] = q
            d += q * q
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


@inlined
def _steps(log_field: float, sharpness: float) -> float:
    """Measure how far the part's normalised radius is above 1."""
    if log_field > 0.0:
        return -0.5 * log_field / sharpness
    return math.sqrt(1.0 - log_field / sharpness) - 1.0


@inlined
def _slope(log_field: float, sharpness: float) -> float:
    """Derivative of `_steps` with respect to log(f / C)."""
    if log_field > 0.0:
        return -0.5 / sharpness
    return -0.5 / (sharpness * math.sqrt(1.0 - log_field / sharpness))


@inlined
def _part_scale(world: Any, low: int, high: int, terms: Any) -> float:
    """Metres per unit of the part's normalised radius."""
    scale = 0.0
    for i in range(low, high):
        if terms[i - low, SHARE] > 0.0:
            scale += terms[i - low, SHARE] * _scale(world[i], terms[i - low])[0]
    return scale


@inlined
def _scale(ellipsoid: Any, terms: Any) -> Any:
    """Metres per unit of one ellipsoid's normalised radius, and its derivatives by d, n and m. With q = y / h: d = Σ
    q², n = Σ q² / h², m = Σ q² h². Who asks for the first alone does not pay for the others."""
    d, n, m = terms[D], 0.0, 0.0
    for axis in range(3):
        square = terms[Q + axis] ** 2
        n += square * ellipsoid[INVERSE + axis]
        m += square * ellipsoid[SQUARE + axis]
    inside, steepest = max(0.0, 1.0 - d), ellipsoid[STEEPEST]
    below = n + inside * inside * steepest
    near = math.sqrt((d + inside * inside) / below)
    near_d = (1.0 - 2.0 * inside + 2.0 * near * near * inside * steepest) / (2.0 * near * below)
    near_n = -0.5 * near / below
    if d <= 1.0:
        return near, near_d, near_n, 0.0
    radius = math.sqrt(d)
    far = math.sqrt(m) / radius
    beyond = 1.0 - 1.0 / radius
    weight = beyond * beyond
    by_d = (1.0 - weight) * near_d - weight * 0.5 * far / d + (far - near) * beyond / (radius * d)
    return near + weight * (far - near), by_d, (1.0 - weight) * near_n, weight * 0.5 * far / m


@inlined
def _add_gradient(
    ellipsoid: Any, terms: Any, sharpness: float, kind: int, steps: float, slope: float, scale: float, gradient: Any
) -> Any:
    """With what one ellipsoid contributes to the residual's gradient with respect to the point, in the world's axes."""
    g0, g1, g2 = gradient
    share = terms[SHARE]
    if share == 0.0:
        return g0, g1, g2
    by_d, by_n, by_m = -sharpness * share * slope * scale, 0.0, 0.0
    if kind == DISTANCE:
        own, own_d, own_n, own_m = _scale(ellipsoid, terms)
        by_d += share * steps * (own_d - sharpness * (own - scale))
        by_n, by_m = share * steps * own_n, share * steps * own_m
    for axis in range(3):
        m = AXES + 3 * axis
        by_q = 2.0 * terms[Q + axis] * (by_d + by_n * ellipsoid[INVERSE + axis] + by_m * ellipsoid[SQUARE + axis])
        g0, g1, g2 = g0 + by_q * ellipsoid[m], g1 + by_q * ellipsoid[m + 1], g2 + by_q * ellipsoid[m + 2]
    return g0, g1, g2


@inlined
def _add_row(screws: Any, point: Any, gradient: Any, first: bool, row: Any) -> None:
    """Add −(w · (X × g) + v · g) for the screws (6, P) of a joint to a row (P,), or write it if it is the first."""
    (g0, g1, g2), (x, y, z) = gradient, (point[0], point[1], point[2])
    t0, t1, t2 = y * g2 - z * g1, z * g0 - x * g2, x * g1 - y * g0
    for p in range(row.shape[0]):
        row[p] = (0.0 if first else row[p]) - (
            screws[0, p] * t0 + screws[1, p] * t1 + screws[2, p] * t2
            + screws[3, p] * g0 + screws[4, p] * g1 + screws[5, p] * g2
        )  # fmt: skip


@inlined
def _posed(
    pose: Any, parents: Any, offsets: Any, dof_joints: Any, dof_axes: Any, table: Any, joints: Any, screws: Any
) -> Any:
    """The ellipsoids' table in the world; fills screws (J, 6, P) unless it is empty."""
    rotations, positions = np.empty((parents.shape[0], 3, 3)), np.empty((parents.shape[0], 3))
    _forward(pose, parents, offsets, dof_joints, dof_axes, rotations, positions, screws)
    world = np.empty_like(table)
    _to_world(table, joints, rotations, positions, world)
    return world


@inlined
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


@inlined
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


@inlined
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


@inlined
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


@inlined
def _turn(rotations: Any, j: int, x: float, y: float, z: float, s: float, c: float) -> None:
    """Multiply joint j's frame by the rotation about a unit axis with sine s and cosine c (Rodrigues' formula)."""
    t = 1.0 - c
    for a in range(3):
        r0, r1, r2 = rotations[j, a, 0], rotations[j, a, 1], rotations[j, a, 2]
        rotations[j, a, 0] = r0 * (c + t * x * x) + r1 * (t * x * y + s * z) + r2 * (t * x * z - s * y)
        rotations[j, a, 1] = r0 * (t * x * y - s * z) + r1 * (c + t * y * y) + r2 * (t * y * z + s * x)
        rotations[j, a, 2] = r0 * (t * x * z + s * y) + r1 * (t * y * z - s * x) + r2 * (c + t * z * z)
