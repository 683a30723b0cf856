"""Cost, gradient and Gauss–Newton blocks of poses seen as 2-D joints: the kernels behind `keypoint_problem`.

Every frame's terms gather, joint by joint, a vector m (3,) and a matrix M (3, 3): Σ s g and Σ c s sᵀ over the residuals
r that the joint has in all views, with s = ∂r/∂x, and g and c the loss's gradient and curvature. Then, once a joint
with its derivative D (3, P), gradient += Dᵀ m and block += Dᵀ M D, over the degrees of freedom that move it only.

Kernels take `terms`, a tuple of tuples, for J joints, P degrees of freedom, T frames, K keypoints of C cameras:

- chain: parents (J,), offsets (J, 3), dof_joints (P,), dof_axes (P, 3), movers (J, m) which degrees of freedom move
  each joint, n_movers (J,);
- marks: first (T + 1,) keypoint of each frame, joints (K,), cameras (K,), pixels (K, 2), whitening (K,) 1/px, rows
  (C, 23) of `Camera.row`;
- loss: its code and scale of the keypoints' residuals;
- prior: low (P,), high (P,), limit weight (1,), mean (1 or T, P), precision (1 or T, P, P) of the pose;
- aims: joints (A,), places (T, A, 3) m that they are to reach, weight (1,) 1/m²;
- stance: masses (J,), feet (2,) the ankles, or -1 without, balance (3,) forward m, left m, 1/m, ground (2,) m and 1/m,
  a NaN height without.
"""

from typing import Any

import numpy as np

from workbench.body.kinematics import _axis_rotation
from workbench.utils.kernel_cache import kernel

SQUARED, HUBER, GEMAN_MCCLURE = 0, 1, 2
BEHIND = 1e3
"""Residual of a keypoint whose joint is behind the camera, in standard deviations."""
_LEAST_DEPTH_M = 1e-6
_FIRST_DAMPING, _LARGEST_DAMPING = 1e-3, 1e12

_inner = kernel(no_cpython_wrapper=True, no_cfunc_wrapper=True)
"""Of functions that only kernels call: half as much to compile."""


@_inner
def robustly(r: Any, loss: Any, scale: Any) -> Any:
    """Return ρ(r), its derivative and the curvature (w r)² / (2 ρ) that `core.residual.robust` gives it."""
    z = r / scale
    if loss == HUBER:
        size = abs(z)
        rho, w = (0.5 * z * z, 1.0) if size <= 1.0 else (size - 0.5, 1.0 / size)
    elif loss == GEMAN_MCCLURE:
        near = 1.0 / (1.0 + z * z)
        rho, w = 0.5 * (1.0 - near), near * near
    else:
        rho, w = 0.5 * z * z, 1.0
    rho *= scale * scale
    return rho, w * r, (w * r) ** 2 / (2.0 * rho) if rho > 0.0 else 1.0


@_inner
def _kinematics(pose: Any, chain: Any, rotations: Any, positions: Any, axes: Any) -> None:
    """Write the joints' frames (J, 3, 3) and positions (J, 3), and the world axes (P, 3) of the degrees of freedom."""
    parents, offsets, dof_joints, dof_axes, _, _ = chain
    turn, p = np.empty((3, 3)), 3
    for q in range(3):
        for a in range(3):
            axes[q, a] = dof_axes[q, a]
    for j in range(len(parents)):
        parent, frame = parents[j], rotations[j]
        for a in range(3):
            if parent < 0:
                positions[j, a] = pose[a]
                for b in range(3):
                    frame[a, b] = 1.0 if a == b else 0.0
            else:
                above = rotations[parent]
                place = positions[parent, a]
                for b in range(3):
                    place += above[a, b] * offsets[j, b]
                    frame[a, b] = above[a, b]
                positions[j, a] = place
        while p < len(dof_joints) and dof_joints[p] == j:
            for a in range(3):
                axes[p, a] = frame[a, 0] * dof_axes[p, 0] + frame[a, 1] * dof_axes[p, 1] + frame[a, 2] * dof_axes[p, 2]
            _axis_rotation(dof_axes[p], pose[p], turn)
            for a in range(3):
                r0, r1, r2 = frame[a, 0], frame[a, 1], frame[a, 2]
                for b in range(3):
                    frame[a, b] = r0 * turn[0, b] + r1 * turn[1, b] + r2 * turn[2, b]
            p += 1


@_inner
def joint_rows(j: Any, chain: Any, positions: Any, axes: Any, rows: Any) -> None:
    """Write the derivative of joint j by the degrees of freedom that move it: rows (n_movers[j], 3)."""
    dof_joints, movers, n_movers = chain[2], chain[4], chain[5]
    for i in range(n_movers[j]):
        p = movers[j, i]
        if p < 3:
            for a in range(3):
                rows[i, a] = axes[p, a]
            continue
        origin = dof_joints[p]
        x = positions[j, 0] - positions[origin, 0]
        y = positions[j, 1] - positions[origin, 1]
        z = positions[j, 2] - positions[origin, 2]
        rows[i, 0] = axes[p, 1] * z - axes[p, 2] * y
        rows[i, 1] = axes[p, 2] * x - axes[p, 0] * z
        rows[i, 2] = axes[p, 0] * y - axes[p, 1] * x


@_inner
def _keypoint(x: Any, row: Any, pixel: Any, whitening: Any, slopes: Any, misses: Any) -> None:
    """Write the two residuals of a joint at x (3,) m against a pixel (2,), and their derivative (2, 3) by x, which
    leaves the lens' distortion out."""
    u = row[0] * x[0] + row[1] * x[1] + row[2] * x[2] + row[9]
    v = row[3] * x[0] + row[4] * x[1] + row[5] * x[2] + row[10]
    depth = row[6] * x[0] + row[7] * x[1] + row[8] * x[2] + row[11]
    for a in range(3):
        slopes[0, a] = whitening * row[12] * (row[a] - u / depth * row[6 + a]) / depth
        slopes[1, a] = whitening * row[13] * (row[3 + a] - v / depth * row[6 + a]) / depth
    if depth <= _LEAST_DEPTH_M:
        misses[0], misses[1] = BEHIND, BEHIND
        return
    a, b = u / depth, v / depth
    k1, k2, p1, p2, k3 = row[16], row[17], row[18], row[19], row[20]
    r2 = a * a + b * b
    radial = 1.0 + r2 * (k1 + r2 * (k2 + r2 * k3))
    bent_a = a * radial + 2.0 * p1 * a * b + p2 * (r2 + 2.0 * a * a)
    bent_b = b * radial + p1 * (r2 + 2.0 * b * b) + 2.0 * p2 * a * b
    misses[0] = (bent_a * row[12] + row[14] - pixel[0]) * whitening
    misses[1] = (bent_b * row[13] + row[15] - pixel[1]) * whitening


@kernel()
def keypoint_misses(positions: Any, marks: Any, misses: Any) -> None:
    """Write the residuals (K, 2) of the keypoints, of joints at positions (T, J, 3)."""
    first, joints, cameras, pixels, whitening, rows = marks
    slopes = np.empty((2, 3))
    for t in range(len(positions)):
        for k in range(first[t], first[t + 1]):
            _keypoint(positions[t, joints[k]], rows[cameras[k]], pixels[k], whitening[k], slopes, misses[k])


@_inner
def _keypoints(t: Any, marks: Any, loss: Any, positions: Any, pulls: Any, stiffness: Any) -> Any:
    """Add frame t's keypoints to m (J, 3) and M (J, 3, 3); returns their cost."""
    first, joints, cameras, pixels, whitening, rows = marks
    slopes, misses, cost = np.empty((2, 3)), np.empty(2), 0.0
    for k in range(first[t], first[t + 1]):
        j = joints[k]
        _keypoint(positions[j], rows[cameras[k]], pixels[k], whitening[k], slopes, misses)
        for i in range(2):
            rho, pull, curvature = robustly(misses[i], loss[0], loss[1])
            cost += rho
            for a in range(3):
                pulls[j, a] += pull * slopes[i, a]
                for b in range(3):
                    stiffness[j, a, b] += curvature * slopes[i, a] * slopes[i, b]
    return cost


@_inner
def _aims(t: Any, aims: Any, positions: Any, pulls: Any, stiffness: Any) -> Any:
    """Add the places that joints of frame t are to reach to m and M; returns their cost."""
    joints, places, weight = aims
    cost = 0.0
    for k in range(len(joints)):
        j = joints[k]
        for a in range(3):
            off = positions[j, a] - places[t, k, a]
            cost += 0.5 * weight[0] * off * off
            pulls[j, a] += weight[0] * off
            stiffness[j, a, a] += weight[0]
    return cost


@_inner
def add_joint(
    j: Any, chain: Any, positions: Any, axes: Any, pull: Any, stiffness: Any, rows: Any, gradient: Any, block: Any
) -> None:
    """Add Dᵀ m and the lower triangle of Dᵀ M D of joint j, with m (3,) and M (3, 3)."""
    movers, n = chain[4], chain[5][j]
    joint_rows(j, chain, positions, axes, rows)
    for i in range(n):
        x, y, z = rows[i, 0], rows[i, 1], rows[i, 2]
        gradient[movers[j, i]] += x * pull[0] + y * pull[1] + z * pull[2]
        u = stiffness[0, 0] * x + stiffness[0, 1] * y + stiffness[0, 2] * z
        v = stiffness[1, 0] * x + stiffness[1, 1] * y + stiffness[1, 2] * z
        w = stiffness[2, 0] * x + stiffness[2, 1] * y + stiffness[2, 2] * z
        for k in range(i + 1):
            block[movers[j, i], movers[j, k]] += rows[k, 0] * u + rows[k, 1] * v + rows[k, 2] * w


@_inner
def _habits(t: Any, pose: Any, prior: Any, gradient: Any, block: Any) -> Any:
    """Add the limits and the Gaussian prior of frame t's pose; returns their cost."""
    low, high, weight, means, precisions = prior
    mean, precision = means[min(t, len(means) - 1)], precisions[min(t, len(precisions) - 1)]
    cost, n = 0.0, len(pose)
    for p in range(n):
        beyond = pose[p] - min(max(pose[p], low[p]), high[p])
        if beyond != 0.0:
            cost += 0.5 * weight[0] * beyond * beyond
            gradient[p] += weight[0] * beyond
            block[p, p] += weight[0]
    for p in range(n):
        pull = 0.0
        for q in range(n):
            pull += precision[p, q] * (pose[q] - mean[q])
        gradient[p] += pull
        cost += 0.5 * pull * (pose[p] - mean[p])
        for q in range(p + 1):
            block[p, q] += precision[p, q]
    return cost


@_inner
def _add_row(miss: Any, row: Any, loss: Any, scale: Any, gradient: Any, block: Any) -> Any:
    """Add one residual with its derivative row (P,); returns its cost."""
    rho, pull, curvature = robustly(miss, loss, scale)
    for p in range(len(row)):
        if row[p] != 0.0:
            gradient[p] += pull * row[p]
            for q in range(p + 1):
                block[p, q] += curvature * row[p] * row[q]
    return rho


@_inner
def _stance(pose: Any, stance: Any, chain: Any, positions: Any, axes: Any, rows: Any, gradient: Any, block: Any) -> Any:
    """Add balance and the height of the lower foot, see `balance_residual` and `ground_residual`; returns their
    cost."""
    masses, feet, balance, ground = stance
    if feet[0] < 0:
        return 0.0
    movers, n_movers, n = chain[4], chain[5], len(pose)
    moved = np.zeros((3, 3, n))  # of the centre of mass, the left and the right ankle
    centre = np.zeros(3)
    for j in range(len(masses)):
        own = feet[0] == j or feet[1] == j
        if masses[j] == 0.0 and not own:
            continue
        joint_rows(j, chain, positions, axes, rows)
        for a in range(3):
            centre[a] += masses[j] * positions[j, a]
            for i in range(n_movers[j]):
                moved[0, a, movers[j, i]] += masses[j] * rows[i, a]
                if own:
                    moved[1 if feet[0] == j else 2, a, movers[j, i]] = rows[i, a]
    left, right = positions[feet[0]], positions[feet[1]]
    off_x, off_y = centre[0] - left[0], centre[1] - left[1]
    stance_x, stance_y = right[0] - left[0], right[1] - left[1]
    square = max(stance_x * stance_x + stance_y * stance_y, 1e-9)
    part = (
        off_x * stance_x + off_y * stance_y
    ) / square  # how far along the line between the ankles the nearest point is
    free = 0.0 < part < 1.0
    part_at = min(max(part, 0.0), 1.0)
    ahead_row, left_row = np.empty(n), np.empty(n)
    cos, sin = np.cos(pose[3]), np.sin(pose[3])
    x, y = off_x - part_at * stance_x, off_y - part_at * stance_y
    for p in range(n):
        d_off_x, d_off_y = moved[0, 0, p] - moved[1, 0, p], moved[0, 1, p] - moved[1, 1, p]
        d_x, d_y = moved[2, 0, p] - moved[1, 0, p], moved[2, 1, p] - moved[1, 1, p]
        d_part = 0.0
        if free:
            d_part = stance_x * d_off_x + stance_y * d_off_y
            d_part += (off_x - 2.0 * part * stance_x) * d_x + (off_y - 2.0 * part * stance_y) * d_y
            d_part /= square
        e_x, e_y = d_off_x - part_at * d_x - stance_x * d_part, d_off_y - part_at * d_y - stance_y * d_part
        ahead_row[p], left_row[p] = balance[2] * (cos * e_x + sin * e_y), balance[2] * (cos * e_y - sin * e_x)
    ahead_row[3] += balance[2] * (cos * y - sin * x)
    left_row[3] += balance[2] * (-cos * x - sin * y)
    cost = _add_row((cos * x + sin * y - balance[0]) * balance[2], ahead_row, HUBER, 1.0, gradient, block)
    cost += _add_row((cos * y - sin * x - balance[1]) * balance[2], left_row, HUBER, 1.0, gradient, block)
    if np.isfinite(ground[0]):
        foot = 1 if left[2] <= right[2] else 2
        miss = (min(left[2], right[2]) - ground[0]) * ground[1]
        for p in range(n):
            left_row[p] = ground[1] * moved[foot, 2, p]
        cost += _add_row(miss, left_row, HUBER, 2.0, gradient, block)
    return cost


@_inner
def _clear(gradient: Any, block: Any, pulls: Any, stiffness: Any) -> None:
    for p in range(len(gradient)):
        gradient[p] = 0.0
        for q in range(len(gradient)):
            block[p, q] = 0.0
    for j in range(len(pulls)):
        for a in range(3):
            pulls[j, a] = 0.0
            for b in range(3):
                stiffness[j, a, b] = 0.0


@_inner
def _frame(
    t: Any, pose: Any, terms: Any, room: Any,
    gradient: Any, block: Any,
) -> Any:  # fmt: skip
    """Write gradient (P,) and block (P, P), its lower triangle, of one frame; returns its cost. room: rotations
    (J, 3, 3), positions (J, 3), axes (P, 3), m (J, 3), M (J, 3, 3), rows (m, 3), which are overwritten."""
    chain, marks, loss, aims, prior, stance = terms
    rotations, positions, axes, pulls, stiffness, rows = room
    _clear(gradient, block, pulls, stiffness)
    _kinematics(pose, chain, rotations, positions, axes)
    cost = _keypoints(t, marks, loss, positions, pulls, stiffness)
    cost += _aims(t, aims, positions, pulls, stiffness)
    for j in range(len(pulls)):
        if stiffness[j, 0, 0] + stiffness[j, 1, 1] + stiffness[j, 2, 2] > 0.0:
            add_joint(j, chain, positions, axes, pulls[j], stiffness[j], rows, gradient, block)
    cost += _habits(t, pose, prior, gradient, block)
    return cost + _stance(pose, stance, chain, positions, axes, rows, gradient, block)


@kernel()
def expand_frames(
    poses: Any, first: Any, terms: Any, positions: Any,
    axes: Any, stiffness: Any, gradients: Any, blocks: Any,
) -> Any:  # fmt: skip
    """Write, of poses (n, P) of the frames from `first` on, positions (n, J, 3), axes (n, P, 3), M (n, J, 3, 3),
    gradients (n, P) and blocks (n, P, P); returns the cost."""
    rotations, rows = np.empty((positions.shape[1], 3, 3)), np.empty((terms[0][4].shape[1], 3))
    pulls, cost = np.empty((positions.shape[1], 3)), 0.0
    for i in range(len(poses)):
        room = (rotations, positions[i], axes[i], pulls, stiffness[i], rows)
        cost += _frame(first + i, poses[i], terms, room, gradients[i], blocks[i])
    return cost


@kernel()
def add_ties(
    first: Any, frames: Any, joints: Any, whitening: Any, scale: Any, chain: Any, positions: Any, axes: Any,
    gradients: Any, blocks: Any, between: Any,
) -> Any:  # fmt: skip
    """Add ties of joints (K,) from each of frames (K,) to the next: three residuals whitening (K,) · (x' − x) under
    Huber's loss. positions (n, J, 3) and axes (n, P, 3) begin with frame `first`. between: (n, P, P), row of the next
    frame and column of this one, is added to; returns the cost."""
    movers, n_movers, cost = chain[4], chain[5], 0.0
    before, after = np.empty((chain[4].shape[1], 3)), np.empty((chain[4].shape[1], 3))
    for k in range(len(frames)):
        i, j = frames[k] - first, joints[k]
        joint_rows(j, chain, positions[i], axes[i], before)
        joint_rows(j, chain, positions[i + 1], axes[i + 1], after)
        for a in range(3):
            rho, pull, curvature = robustly(whitening[k] * (positions[i + 1, j, a] - positions[i, j, a]), HUBER, scale)
            cost += rho
            pull, curvature = pull * whitening[k], curvature * whitening[k] ** 2
            for m in range(n_movers[j]):
                p = movers[j, m]
                gradients[i, p] -= pull * before[m, a]
                gradients[i + 1, p] += pull * after[m, a]
                for n in range(n_movers[j]):
                    q = movers[j, n]
                    between[i, p, q] -= curvature * after[m, a] * before[n, a]
                    if n <= m:
                        blocks[i, p, q] += curvature * before[m, a] * before[n, a]
                        blocks[i + 1, p, q] += curvature * after[m, a] * after[n, a]
    return cost


@kernel()
def fill_band(blocks: Any, between: Any, bends: Any, weights: Any, cells: Any) -> None:
    """Write the lower band (2 P + 1, n P) of blocks (n, P, P), of `between` (n, P, P) each frame and the next, and of
    the second differences: bends (n, 3), how each frame meets itself, the next and the one after, times weights (P,)
    of each degree of freedom."""
    n, size = len(blocks), len(weights)
    for t in range(n):
        for q in range(size):
            column = t * size + q
            for k in range(2 * size + 1):
                cells[k, column] = 0.0
            for p in range(q, size):
                cells[p - q, column] = blocks[t, p, q]
            cells[0, column] += bends[t, 0] * weights[q]
            if t + 1 < n:
                for p in range(size):
                    cells[size + p - q, column] = between[t, p, q]
                cells[size, column] += bends[t, 1] * weights[q]
            if t + 2 < n:
                cells[2 * size, column] = bends[t, 2] * weights[q]


@_inner
def _solved(matrix: Any, damping: Any, right: Any, root: Any, x: Any) -> Any:
    """Solve (A + diag(damping)) x = right by Cholesky's factor, of a lower triangle A (n, n); False where that is not
    positive definite."""
    n = len(right)
    for i in range(n):
        for j in range(i + 1):
            total = matrix[i, j] + (damping[i] if i == j else 0.0)
            for k in range(j):
                total -= root[i, k] * root[j, k]
            if i > j:
                root[i, j] = total / root[j, j]
            elif total <= 0.0:
                return False
            else:
                root[i, i] = np.sqrt(total)
    for i in range(n):
        total = right[i]
        for k in range(i):
            total -= root[i, k] * x[k]
        x[i] = total / root[i, i]
    for i in range(n - 1, -1, -1):
        total = x[i]
        for k in range(i + 1, n):
            total -= root[k, i] * x[k]
        x[i] = total / root[i, i]
    return True


@_inner
def _pulled(
    t: Any, pose: Any, near: Any, pull: Any, terms: Any,
    room: Any, gradient: Any, block: Any, trust: Any,
) -> Any:  # fmt: skip
    """Expand one frame, with a pull (P,), one over variances, to the pose `near` (P,) that no damping counts."""
    cost = _frame(t, pose, terms, room, gradient, block)
    for p in range(len(pose)):
        trust[p] = block[p, p]
        block[p, p] += pull[p]
        gradient[p] += pull[p] * (pose[p] - near[p])
        cost += 0.5 * pull[p] * (pose[p] - near[p]) ** 2
    return cost


@_inner
def fit_one(t: Any, pose: Any, near: Any, pull: Any, terms: Any, room: Any, max_iterations: Any, tolerance: Any) -> Any:
    """Move `pose` (P,) to a minimum of frame t's cost by Levenberg and Marquardt's method, as `solver.minimise` does;
    return that cost."""
    n = len(pose)
    gradients, blocks, trusts = np.empty((2, n)), np.empty((2, n, n)), np.empty((2, n))  # here and there
    root, step, damping, moved = np.empty((n, n)), np.empty(n), np.empty(n), np.empty(n)
    factor, growth, iterations, now = _FIRST_DAMPING, 2.0, 0, 0
    cost = _pulled(t, pose, near, pull, terms, room, gradients[0], blocks[0], trusts[0])
    while iterations < max_iterations and factor < _LARGEST_DAMPING:
        gradient, largest, steep = gradients[now], 0.0, 0.0
        for p in range(n):
            largest, steep = max(largest, trusts[now, p]), max(steep, abs(gradient[p]))
        if steep == 0.0:
            break
        for p in range(n):
            damping[p] = factor * max(trusts[now, p], 1e-9 * largest)
        if not _solved(blocks[now], damping, gradient, root, step):
            factor, growth = factor * growth, 2.0 * growth
            continue
        promised = 0.0
        for p in range(n):
            promised += 0.5 * step[p] * (damping[p] * step[p] + gradient[p])
            moved[p] = pose[p] - step[p]
        if promised <= tolerance * cost:
            break
        there = _pulled(t, moved, near, pull, terms, room, gradients[1 - now], blocks[1 - now], trusts[1 - now])
        iterations += 1
        gain = (cost - there) / promised
        if gain > 0.0:
            for p in range(n):
                pose[p] = moved[p]
            cost, now = there, 1 - now
            factor, growth = factor * max(1.0 / 3.0, 1.0 - (2.0 * gain - 1.0) ** 3), 2.0
        else:
            factor, growth = factor * growth, 2.0 * growth
    return cost


@kernel()
def fit_frames(
    poses: Any, follow: bool, pulls: Any, terms: Any, max_iterations: Any, tolerance: Any, costs: Any,
) -> None:  # fmt: skip
    """Fit poses (T, P), each frame for itself, and pulled by pulls (T, P), one over variances, to where it starts: its
    own pose, or with `follow` the pose found in the frame before. Writes their costs (T,)."""
    n_joints, n = len(terms[0][0]), poses.shape[1]
    room = (
        np.empty((n_joints, 3, 3)), np.empty((n_joints, 3)), np.empty((n, 3)), np.empty((n_joints, 3)),
        np.empty((n_joints, 3, 3)), np.empty((terms[0][4].shape[1], 3)),
    )  # fmt: skip
    near = np.empty(n)
    for t in range(len(poses)):
        for p in range(n):
            if follow and t > 0:
                poses[t, p] = poses[t - 1, p]
            near[p] = poses[t, p]
        costs[t] = fit_one(t, poses[t], near, pulls[t], terms, room, max_iterations, tolerance)
