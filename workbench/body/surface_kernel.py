"""The fused kernels of the implicit surface, for K points and one pose, or many; `surface` has the formulas.

Every degree of freedom moves the joints below it along a screw: a rotation about the world axis w through o, or a
translation along v, with v = o × w for a rotation. Relative to the body, a point X fixed in the world moves the other
way, so a residual with the gradient g at X changes by −(w · (X × g) + v · g). The screws that move a joint are in one
table per joint, with zeros for the others: a row of the Jacobian is one pass over contiguous memory, without a branch.
"""

import math
from typing import Any

import numpy as np

from workbench.body.simd_kinematics import FAST, inlined
from workbench.utils.kernel_cache import kernel

FIELD, DISTANCE = 0, 1
MARGIN = 1e-9  # relative tolerance of lower bounds, so that rounding excludes no part
NEGLIGIBLE = -40.0  # log(f_i / f) below which an ellipsoid's weight is zero to double precision
POINTS = 32  # points per computation of lower bounds; 16 would be unrolled too early for vectorised square roots

# Columns of the ellipsoids' table on their joints, and in the world: the centre, the axes over the half sizes (rows of
# three, which map the ellipsoid to the unit sphere), 1 / half size² and half size² along each, and
# the largest 1 / half size².
CENTRE, AXES, INVERSE, SQUARE, STEEPEST = 0, 3, 12, 15, 18
N_COLUMNS = 19
# Columns of the work space, a row for each ellipsoid of a part: the point in the ellipsoid's unit coordinates, its
# algebraic distance and its weight in the part's field.
Q, D, WEIGHT = 0, 3, 4
N_TERMS = 5


@kernel(error_model="numpy", fastmath=FAST)
def attach(
    table: Any, joints: Any, parts: Any, sharpness: float, kind: int, rotations: Any, positions: Any,
    points: Any, attachment: Any,
) -> None:  # fmt: skip
    """Write attachment (K,): the part with the smallest |log(f / C)| or |pseudo-distance|; the first of equals."""
    world = np.empty_like(table)
    _to_world(table, joints, rotations, positions, world)
    max_excess, thinnest = _bound_constants(table, parts)
    lower_bounds, terms = np.empty((max_excess.shape[0], POINTS)), np.empty((2, table.shape[0], N_TERMS))
    for k in range(points.shape[0]):
        if k % POINTS == 0:
            _lower_bounds(world, parts, max_excess, thinnest, sharpness, kind, points, k, lower_bounds)
        attachment[k] = _nearest(world, parts, lower_bounds, k % POINTS, points[k], sharpness, kind, terms)[0]


@kernel(error_model="numpy", fastmath=FAST)
def residuals(
    pose: Any, parents: Any, offsets: Any, dof_joints: Any, dof_axes: Any,
    table: Any, joints: Any, parts: Any, sharpness: float, level: float, kind: int,
    points: Any, attachment: Any, values: Any,
) -> None:  # fmt: skip
    """Write values (K,): the residuals of points attached to parts."""
    screws = np.empty((0, 6, 0))
    world = _posed_ellipsoids(pose, parents, offsets, dof_joints, dof_axes, table, joints, screws)
    terms = np.empty((table.shape[0], N_TERMS))
    for k in range(points.shape[0]):
        low, high = parts[attachment[k]], parts[attachment[k] + 1]
        log_field, scale = _evaluate_part(world, low, high, points[k], sharpness, kind, terms)
        values[k] = level * math.expm1(log_field) if kind == FIELD else _radius_offset(log_field, sharpness) * scale


@kernel(error_model="numpy", fastmath=FAST)
def residual_jacobian(
    pose: Any, parents: Any, offsets: Any, dof_joints: Any, dof_axes: Any,
    table: Any, joints: Any, parts: Any, sharpness: float, level: float, kind: int,
    points: Any, attachment: Any, values: Any, jacobian: Any,
) -> None:  # fmt: skip
    """Write values (K,) as `residuals`, and jacobian (K, P) with respect to the pose."""
    screws = np.zeros((parents.shape[0], 6, pose.shape[0]))
    world = _posed_ellipsoids(pose, parents, offsets, dof_joints, dof_axes, table, joints, screws)
    terms = np.empty((table.shape[0], N_TERMS))
    for k in range(points.shape[0]):
        low, high = parts[attachment[k]], parts[attachment[k] + 1]
        log_field, scale = _evaluate_part(world, low, high, points[k], sharpness, kind, terms)
        values[k] = _row(
            world, joints, screws, low, high, points[k], log_field, scale, sharpness, level, kind, terms, jacobian[k]
        )


@kernel(error_model="numpy", fastmath=FAST)
def nearest_residual_jacobian(
    pose: Any, parents: Any, offsets: Any, dof_joints: Any, dof_axes: Any,
    table: Any, joints: Any, parts: Any, sharpness: float, level: float, kind: int,
    points: Any, values: Any, jacobian: Any,
) -> None:  # fmt: skip
    """Write residuals and derivatives of points attached as by `attach`, whose search has evaluated the parts."""
    screws = np.zeros((parents.shape[0], 6, pose.shape[0]))
    world = _posed_ellipsoids(pose, parents, offsets, dof_joints, dof_axes, table, joints, screws)
    max_excess, thinnest = _bound_constants(table, parts)
    lower_bounds, terms = np.empty((max_excess.shape[0], POINTS)), np.empty((2, table.shape[0], N_TERMS))
    for k in range(points.shape[0]):
        if k % POINTS == 0:
            _lower_bounds(world, parts, max_excess, thinnest, sharpness, kind, points, k, lower_bounds)
        part, log_field, scale, side = _nearest(
            world, parts, lower_bounds, k % POINTS, points[k], sharpness, kind, terms
        )
        values[k] = _row(
            world, joints, screws, parts[part], parts[part + 1], points[k], log_field, scale, sharpness, level, kind,
            terms[side], jacobian[k],
        )  # fmt: skip


@kernel(error_model="numpy", fastmath=FAST)
def nearest_distances(
    first: int, last: int, poses: Any, parents: Any, offsets: Any, dof_joints: Any, dof_axes: Any,
    table: Any, joints: Any, parts: Any, sharpness: float, points: Any, distances: Any,
) -> None:  # fmt: skip
    """Write distances (N, K), rows `first` to `last`: pseudo-distances of points to the nearest part in each of N
    poses."""
    screws = np.empty((0, 6, 0))
    max_excess, thinnest = _bound_constants(table, parts)
    lower_bounds, terms = np.empty((max_excess.shape[0], POINTS)), np.empty((2, table.shape[0], N_TERMS))
    for i in range(first, last):
        world = _posed_ellipsoids(poses[i], parents, offsets, dof_joints, dof_axes, table, joints, screws)
        for k in range(points.shape[0]):
            if k % POINTS == 0:
                _lower_bounds(world, parts, max_excess, thinnest, sharpness, DISTANCE, points, k, lower_bounds)
            _, log_field, scale, _ = _nearest(
                world, parts, lower_bounds, k % POINTS, points[k], sharpness, DISTANCE, terms
            )
            distances[i, k] = _radius_offset(log_field, sharpness) * scale


@inlined
def _bound_constants(table: Any, parts: Any) -> Any:
    """Return, for each part (B,), the maximum excess of log(f / C) over its largest term's, and the smallest half size,
    a lower bound of the part's scale."""
    n_parts = parts.shape[0] - 1
    max_excess, thinnest = np.empty(n_parts), np.empty(n_parts)
    for part in range(n_parts):
        max_excess[part] = math.log(parts[part + 1] - parts[part])
        thinnest[part] = 1.0 / math.sqrt(table[parts[part] : parts[part + 1], STEEPEST].max())
    return max_excess, thinnest


@inlined
def _lower_bounds(
    world: Any, parts: Any, max_excess: Any, thinnest: Any, sharpness: float, kind: int, points: Any, first: int,
    lower_bounds: Any,
) -> None:  # fmt: skip
    """Write lower_bounds (B, POINTS) of |log(f / C)| or |pseudo-distance| of POINTS points from `first` on. Innermost
    loops run over points without a branch, so that the compiler vectorises them."""
    x, y, z = np.empty(POINTS), np.empty(POINTS), np.empty(POINTS)
    for lane in range(POINTS):
        k = min(first + lane, points.shape[0] - 1)
        x[lane], y[lane], z[lane] = points[k, 0], points[k, 1], points[k, 2]
    for part in range(max_excess.shape[0]):
        row = lower_bounds[part]
        for lane in range(POINTS):
            row[lane] = np.inf
        for i in range(parts[part], parts[part + 1]):
            _lower_distances(world[i], x, y, z, row)
        excess, thin = max_excess[part], thinnest[part]
        for lane in range(POINTS):
            log_field = min(0.0, excess + sharpness * (1.0 - row[lane]))
            row[lane] = -log_field if kind == FIELD else thin * (np.sqrt(1.0 - log_field / sharpness) - 1.0)


@inlined
def _lower_distances(ellipsoid: Any, x: Any, y: Any, z: Any, d: Any) -> None:
    """Lower d (POINTS,) to the algebraic distance of an ellipsoid in the world where that is smaller."""
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
    world: Any, parts: Any, lower_bounds: Any, lane: int, point: Any, sharpness: float, kind: int, terms: Any
) -> Any:  # fmt: skip
    """Return the nearest part of a point, its log(f / C), its scale, and the half of `terms` (2, …) that holds its
    terms. The part of the lowest bound is evaluated first, and is the result if squares overflow; then those whose
    bounds permit."""
    likely = 0
    for part in range(1, lower_bounds.shape[0]):
        if lower_bounds[part, lane] < lower_bounds[likely, lane]:
            likely = part
    nearest, best, best_field, best_scale, side = np.inf, likely, 0.0, 0.0, 0
    for attempt in range(-1, lower_bounds.shape[0]):
        part = likely if attempt < 0 else attempt
        if attempt == likely or lower_bounds[part, lane] > nearest * (1.0 + MARGIN):
            continue
        log_field, scale = _evaluate_part(world, parts[part], parts[part + 1], point, sharpness, kind, terms[1 - side])
        distance = abs(log_field) if kind == FIELD else abs(_radius_offset(log_field, sharpness) * scale)
        if attempt < 0 or distance < nearest or (distance == nearest and part < best):
            nearest, best, best_field, best_scale, side = distance, part, log_field, scale, 1 - side
    return best, best_field, best_scale, side


@inlined
def _row(
    world: Any, joints: Any, screws: Any, low: int, high: int, point: Any, log_field: float, scale: float,
    sharpness: float, level: float, kind: int, terms: Any, row: Any,
) -> Any:  # fmt: skip
    """Return the residual of a point whose part is evaluated; fill its row (P,) of the Jacobian."""
    if kind == FIELD:
        residual, offset, derivative = level * math.expm1(log_field), 0.0, level * math.exp(log_field)
    else:
        offset, derivative = _radius_offset(log_field, sharpness), _radius_offset_derivative(log_field, sharpness)
        residual = offset * scale
    gradient = (0.0, 0.0, 0.0)
    first = True
    for i in range(low, high):
        gradient = _add_gradient(world[i], terms[i - low], sharpness, kind, offset, derivative, scale, gradient)
        if i + 1 == high or joints[i + 1] != joints[i]:
            _add_row(screws[joints[i]], point, gradient, first, row)
            gradient = (0.0, 0.0, 0.0)
            first = False
    return residual


@inlined
def _evaluate_part(world: Any, low: int, high: int, point: Any, sharpness: float, kind: int, terms: Any) -> Any:
    """Return log(f / C) of one part at a point and the part's scale, 1 for the field; fill the part's terms."""
    log_field = _log_field(world, low, high, point, sharpness, terms)
    return log_field, _part_scale(world, low, high, terms) if kind == DISTANCE else 1.0


@inlined
def _log_field(world: Any, low: int, high: int, point: Any, sharpness: float, terms: Any) -> float:
    """Return log(f / C) of one part at a point; fill the part's terms."""
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
        terms[0, WEIGHT] = 1.0
        return top
    total = 0.0
    for row in range(high - low):
        exponent = sharpness * (1.0 - terms[row, D]) - top
        terms[row, WEIGHT] = math.exp(exponent) if exponent > NEGLIGIBLE else 0.0
        total += terms[row, WEIGHT]
    for row in range(high - low):
        terms[row, WEIGHT] /= total
    return top + math.log(total)


@inlined
def _radius_offset(log_field: float, sharpness: float) -> float:
    """Return the part's normalised radius minus 1, or (r² − 1) / 2 inside."""
    if log_field > 0.0:
        return -0.5 * log_field / sharpness
    return math.sqrt(1.0 - log_field / sharpness) - 1.0


@inlined
def _radius_offset_derivative(log_field: float, sharpness: float) -> float:
    """Return the derivative of `_radius_offset` with respect to log(f / C)."""
    if log_field > 0.0:
        return -0.5 / sharpness
    return -0.5 / (sharpness * math.sqrt(1.0 - log_field / sharpness))


@inlined
def _part_scale(world: Any, low: int, high: int, terms: Any) -> float:
    """Return metres per unit of the part's normalised radius."""
    scale = 0.0
    for i in range(low, high):
        if terms[i - low, WEIGHT] > 0.0:
            scale += terms[i - low, WEIGHT] * _scale(world[i], terms[i - low])[0]
    return scale


@inlined
def _scale(ellipsoid: Any, terms: Any) -> Any:
    """Return metres per unit of one ellipsoid's normalised radius, and its derivatives by d, n and m. With q = y / h: d
    = Σ q², n = Σ q² / h², m = Σ q² h². Unused derivatives are removed by the compiler."""
    d, n, m = terms[D], 0.0, 0.0
    for axis in range(3):
        square = terms[Q + axis] ** 2
        n += square * ellipsoid[INVERSE + axis]
        m += square * ellipsoid[SQUARE + axis]
    inside, steepest = max(0.0, 1.0 - d), ellipsoid[STEEPEST]
    below = n + inside * inside * steepest
    near_scale = math.sqrt((d + inside * inside) / below)
    near_by_d = (1.0 - 2.0 * inside + 2.0 * near_scale * near_scale * inside * steepest) / (2.0 * near_scale * below)
    near_by_n = -0.5 * near_scale / below
    if d <= 1.0:
        return near_scale, near_by_d, near_by_n, 0.0
    radius = math.sqrt(d)
    far_scale = math.sqrt(m) / radius
    beyond = 1.0 - 1.0 / radius
    weight = beyond * beyond
    by_d = (1.0 - weight) * near_by_d - weight * 0.5 * far_scale / d + (far_scale - near_scale) * beyond / (radius * d)
    return (
        near_scale + weight * (far_scale - near_scale), by_d, (1.0 - weight) * near_by_n, weight * 0.5 * far_scale / m,
    )  # fmt: skip


@inlined
def _add_gradient(
    ellipsoid: Any, terms: Any, sharpness: float, kind: int, offset: float, derivative: float, scale: float,
    gradient: Any,
) -> Any:  # fmt: skip
    """Return the gradient plus one ellipsoid's term: of the residual with respect to the point, in the world's axes."""
    g0, g1, g2 = gradient
    weight = terms[WEIGHT]
    if weight == 0.0:
        return g0, g1, g2
    by_d, by_n, by_m = -sharpness * weight * derivative * scale, 0.0, 0.0
    if kind == DISTANCE:
        scale_i, scale_by_d, scale_by_n, scale_by_m = _scale(ellipsoid, terms)
        by_d += weight * offset * (scale_by_d - sharpness * (scale_i - scale))
        by_n, by_m = weight * offset * scale_by_n, weight * offset * scale_by_m
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
def _posed_ellipsoids(
    pose: Any, parents: Any, offsets: Any, dof_joints: Any, dof_axes: Any, table: Any, joints: Any, screws: Any
) -> Any:
    """Return the ellipsoids' table in the world; fill screws (J, 6, P) unless it is empty."""
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
            coordinate = positions[joint, a]
            for b in range(3):
                coordinate += rotations[joint, a, b] * table[i, CENTRE + b]
            world[i, CENTRE + a] = coordinate
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
    """Compute joint frames as `kinematics.forward` of one pose, and each joint's screws."""
    n_dofs, with_screws, p = pose.shape[0], screws.shape[0] > 0, 3
    for j in range(parents.shape[0]):
        parent = parents[j]
        for a in range(3):
            positions[j, a] = pose[a]
            for b in range(3):
                rotations[j, a, b] = 1.0 if a == b else 0.0
        if parent >= 0:
            for a in range(3):
                coordinate = positions[parent, a]
                for b in range(3):
                    rotations[j, a, b] = rotations[parent, a, b]
                    coordinate += rotations[parent, a, b] * offsets[j, b]
                positions[j, a] = coordinate
        if with_screws:
            _first_screws(j, parent, p, dof_axes, screws)
        while p < n_dofs and dof_joints[p] == j:
            if with_screws:
                _add_screw(j, p, dof_axes, rotations, positions, screws)
            _rotate(rotations, j, dof_axes[p, 0], dof_axes[p, 1], dof_axes[p, 2], math.sin(pose[p]), math.cos(pose[p]))
            p += 1


@inlined
def _first_screws(j: int, parent: int, p: int, dof_axes: Any, screws: Any) -> None:
    """Copy the screws of a joint's parent, which move the joint too; the root's are the translations."""
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
    """Add the screw of degree of freedom p of joint j, whose frame includes the previous rotations."""
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
def _rotate(rotations: Any, j: int, x: float, y: float, z: float, s: float, c: float) -> None:
    """Multiply joint j's frame by the rotation about a unit axis with sine s and cosine c (Rodrigues' formula)."""
    t = 1.0 - c
    for a in range(3):
        r0, r1, r2 = rotations[j, a, 0], rotations[j, a, 1], rotations[j, a, 2]
        rotations[j, a, 0] = r0 * (c + t * x * x) + r1 * (t * x * y + s * z) + r2 * (t * x * z - s * y)
        rotations[j, a, 1] = r0 * (t * x * y - s * z) + r1 * (c + t * y * y) + r2 * (t * y * z + s * x)
        rotations[j, a, 2] = r0 * (t * x * z + s * y) + r1 * (t * y * z - s * x) + r2 * (c + t * z * z)
