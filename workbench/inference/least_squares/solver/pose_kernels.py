"""Kernels of `pose_problem`: cost, gradient and Gauss–Newton blocks of poses observed as 2-D joints.

Every frame's terms sum, joint by joint, to a vector m (3,) and a matrix M (3, 3): Σ s g and Σ c s sᵀ over the residuals
r of the joint in all views, with s = ∂r/∂x, and the loss's gradient g and curvature c. Then, once per joint with its
Jacobian D (3, P), gradient += Dᵀ m and block += Dᵀ M D, over the degrees of freedom that move it.

Kernels take `terms`, a tuple of tuples, for J joints, P degrees of freedom, T frames, K keypoints of C cameras:

- chain: parents (J,), offsets (J, 3), dof_joints (P,), dof_axes (P, 3), movers (J, m) the degrees of freedom that move
  each joint, n_movers (J,);
- keypoints: first (T + 1,) keypoint of each frame, joints (K,), cameras (K,), pixels (K, 2), whitening (K,) 1/px, rows
  (C, 23) of `Camera.row`;
- loss: its code and scale of the keypoints' residuals;
- prior: lower (P,), upper (P,), limit weight (1,), mean (1 or T, P), precision (1 or T, P, P) of the pose;
- targets: joints (A,), their target positions (T, A, 3) m, weight (1,) 1/m²;
- depths: first (T + 1,) bone of each frame, ends (K, 2) joints, directions (K, 3), whitening (K,) 1/m, least (K,) m,
  see `landmark_depths`;
- stance: masses (J,), feet (2,) the ankles, or -1 without, balance (3,) forward m, left m, 1/m, ground (2,) m and 1/m,
  NaN height if unknown.
"""

from typing import Any

import numpy as np

from workbench.body.kinematics import _axis_rotation
from workbench.core.losses import (
    BALANCE_LOSS,
    BEHIND,
    DEPTH_LOSS,
    FOOT_DRIFT_LOSS,
    GROUND_LOSS,
    LOSSES,
    Loss,
    rho_and_weight,
)
from workbench.inference.least_squares.solver.sparse_solver import FIRST_DAMPING, MAX_DAMPING
from workbench.utils.kernel_cache import kernel

_MIN_DEPTH_M = 1e-6


def _code_and_scale(loss: Loss) -> tuple[int, float]:
    """Return a loss as the kernels' constants."""
    return LOSSES[loss.name], float(loss.scale)


_BALANCE, _GROUND = _code_and_scale(BALANCE_LOSS), _code_and_scale(GROUND_LOSS)
_FOOT_DRIFT, _DEPTH = _code_and_scale(FOOT_DRIFT_LOSS), _code_and_scale(DEPTH_LOSS)

_inner = kernel(no_cpython_wrapper=True, no_cfunc_wrapper=True)
"""Decorator of functions called by kernels only, which halves their compile time."""


@_inner
def robust_terms(r: Any, loss: Any, scale: Any) -> Any:
    """Return ρ(r), its derivative and the curvature (w r)² / (2 ρ) of the residual of `core.residual.robust`."""
    rho, w = rho_and_weight(r / scale, loss)
    rho *= scale * scale
    return rho, w * r, (w * r) ** 2 / (2.0 * rho) if rho > 0.0 else 1.0


@_inner
def _kinematics(pose: Any, chain: Any, rotations: Any, positions: Any, axes: Any) -> None:
    """Write the joints' frames (J, 3, 3) and positions (J, 3), and the world axes (P, 3) of the degrees of freedom."""
    parents, offsets, dof_joints, dof_axes, _, _ = chain
    rotation, p = np.empty((3, 3)), 3
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
                parent_rotation = rotations[parent]
                position = positions[parent, a]
                for b in range(3):
                    position += parent_rotation[a, b] * offsets[j, b]
                    frame[a, b] = parent_rotation[a, b]
                positions[j, a] = position
        while p < len(dof_joints) and dof_joints[p] == j:
            for a in range(3):
                axes[p, a] = frame[a, 0] * dof_axes[p, 0] + frame[a, 1] * dof_axes[p, 1] + frame[a, 2] * dof_axes[p, 2]
            _axis_rotation(dof_axes[p], pose[p], rotation)
            for a in range(3):
                r0, r1, r2 = frame[a, 0], frame[a, 1], frame[a, 2]
                for b in range(3):
                    frame[a, b] = r0 * rotation[0, b] + r1 * rotation[1, b] + r2 * rotation[2, b]
            p += 1


@_inner
def joint_rows(j: Any, chain: Any, positions: Any, axes: Any, rows: Any) -> None:
    """Write the Jacobian of joint j by the degrees of freedom that move it, transposed: rows (n_movers[j], 3)."""
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
def _keypoint_residual(x: Any, row: Any, pixel: Any, whitening: Any, jacobian: Any, residuals: Any) -> None:
    """Write the two residuals of a joint at x (3,) m against a pixel (2,), and their Jacobian (2, 3) by x, which
    neglects lens distortion."""
    u = row[0] * x[0] + row[1] * x[1] + row[2] * x[2] + row[9]
    v = row[3] * x[0] + row[4] * x[1] + row[5] * x[2] + row[10]
    depth = row[6] * x[0] + row[7] * x[1] + row[8] * x[2] + row[11]
    for a in range(3):
        jacobian[0, a] = whitening * row[12] * (row[a] - u / depth * row[6 + a]) / depth
        jacobian[1, a] = whitening * row[13] * (row[3 + a] - v / depth * row[6 + a]) / depth
    if depth <= _MIN_DEPTH_M:
        residuals[0], residuals[1] = BEHIND, BEHIND
        return
    a, b = u / depth, v / depth
    k1, k2, p1, p2, k3 = row[16], row[17], row[18], row[19], row[20]
    r2 = a * a + b * b
    radial = 1.0 + r2 * (k1 + r2 * (k2 + r2 * k3))
    distorted_a = a * radial + 2.0 * p1 * a * b + p2 * (r2 + 2.0 * a * a)
    distorted_b = b * radial + p1 * (r2 + 2.0 * b * b) + 2.0 * p2 * a * b
    residuals[0] = (distorted_a * row[12] + row[14] - pixel[0]) * whitening
    residuals[1] = (distorted_b * row[13] + row[15] - pixel[1]) * whitening


@kernel()
def keypoint_residuals(positions: Any, keypoints: Any, residuals: Any) -> None:
    """Write the residuals (K, 2) of the keypoints of joints at positions (T, J, 3)."""
    first, joints, cameras, pixels, whitening, rows = keypoints
    jacobian = np.empty((2, 3))
    for t in range(len(positions)):
        for k in range(first[t], first[t + 1]):
            _keypoint_residual(
                positions[t, joints[k]], rows[cameras[k]], pixels[k], whitening[k], jacobian, residuals[k]
            )


@_inner
def _add_keypoints(t: Any, keypoints: Any, loss: Any, positions: Any, joint_gradients: Any, joint_hessians: Any) -> Any:
    """Add frame t's keypoints to m (J, 3) and M (J, 3, 3); return their cost."""
    first, joints, cameras, pixels, whitening, rows = keypoints
    jacobian, residuals, cost = np.empty((2, 3)), np.empty(2), 0.0
    for k in range(first[t], first[t + 1]):
        j = joints[k]
        _keypoint_residual(positions[j], rows[cameras[k]], pixels[k], whitening[k], jacobian, residuals)
        for i in range(2):
            rho, derivative, curvature = robust_terms(residuals[i], loss[0], loss[1])
            cost += rho
            for a in range(3):
                joint_gradients[j, a] += derivative * jacobian[i, a]
                for b in range(3):
                    joint_hessians[j, a, b] += curvature * jacobian[i, a] * jacobian[i, b]
    return cost


@_inner
def _add_targets(t: Any, targets: Any, positions: Any, joint_gradients: Any, joint_hessians: Any) -> Any:
    """Add the target positions of joints in frame t to m and M; return their cost."""
    joints, positions_to_reach, weight = targets
    cost = 0.0
    for k in range(len(joints)):
        j = joints[k]
        for a in range(3):
            offset = positions[j, a] - positions_to_reach[t, k, a]
            cost += 0.5 * weight[0] * offset * offset
            joint_gradients[j, a] += weight[0] * offset
            joint_hessians[j, a, a] += weight[0]
    return cost


@_inner
def add_joint(
    j: Any, chain: Any, positions: Any, axes: Any, joint_gradient: Any, joint_hessian: Any, rows: Any,
    gradient: Any, block: Any,
) -> None:  # fmt: skip
    """Add Dᵀ m and the lower triangle of Dᵀ M D of joint j, with m (3,) and M (3, 3)."""
    movers, n = chain[4], chain[5][j]
    joint_rows(j, chain, positions, axes, rows)
    for i in range(n):
        x, y, z = rows[i, 0], rows[i, 1], rows[i, 2]
        gradient[movers[j, i]] += x * joint_gradient[0] + y * joint_gradient[1] + z * joint_gradient[2]
        u = joint_hessian[0, 0] * x + joint_hessian[0, 1] * y + joint_hessian[0, 2] * z
        v = joint_hessian[1, 0] * x + joint_hessian[1, 1] * y + joint_hessian[1, 2] * z
        w = joint_hessian[2, 0] * x + joint_hessian[2, 1] * y + joint_hessian[2, 2] * z
        for k in range(i + 1):
            block[movers[j, i], movers[j, k]] += rows[k, 0] * u + rows[k, 1] * v + rows[k, 2] * w


@_inner
def _add_pose_prior(t: Any, pose: Any, prior: Any, gradient: Any, block: Any) -> Any:
    """Add the limits and the Gaussian prior of frame t's pose; return their cost."""
    lower, upper, weight, means, precisions = prior
    mean, precision = means[min(t, len(means) - 1)], precisions[min(t, len(precisions) - 1)]
    cost, n = 0.0, len(pose)
    for p in range(n):
        excess = pose[p] - min(max(pose[p], lower[p]), upper[p])
        if excess != 0.0:
            cost += 0.5 * weight[0] * excess * excess
            gradient[p] += weight[0] * excess
            block[p, p] += weight[0]
    for p in range(n):
        gradient_p = 0.0
        for q in range(n):
            gradient_p += precision[p, q] * (pose[q] - mean[q])
        gradient[p] += gradient_p
        cost += 0.5 * gradient_p * (pose[p] - mean[p])
        for q in range(p + 1):
            block[p, q] += precision[p, q]
    return cost


@_inner
def _add_row(residual: Any, row: Any, loss: Any, gradient: Any, block: Any) -> Any:
    """Add one residual with its Jacobian row (P,) under a loss, its code and scale; return its cost."""
    rho, derivative, curvature = robust_terms(residual, loss[0], loss[1])
    for p in range(len(row)):
        if row[p] != 0.0:
            gradient[p] += derivative * row[p]
            for q in range(p + 1):
                block[p, q] += curvature * row[p] * row[q]
    return rho


@_inner
def _add_stance(
    pose: Any, stance: Any, chain: Any, positions: Any, axes: Any, rows: Any, gradient: Any, block: Any
) -> Any:
    """Add balance and the height of the lower foot; return their cost.

    The residuals of balance are the offset of the centre of mass from the line between the ankles, forward and to the
    left of the heading, less its nominal value. That of the ground is the height of the lower ankle above it.
    """
    masses, feet, balance, ground = stance
    if feet[0] < 0:
        return 0.0
    movers, n_movers, n = chain[4], chain[5], len(pose)
    jacobians = np.zeros((3, 3, n))  # of the centre of mass, the left and the right ankle
    centre = np.zeros(3)
    for j in range(len(masses)):
        is_foot = feet[0] == j or feet[1] == j
        if masses[j] == 0.0 and not is_foot:
            continue
        joint_rows(j, chain, positions, axes, rows)
        for a in range(3):
            centre[a] += masses[j] * positions[j, a]
            for i in range(n_movers[j]):
                jacobians[0, a, movers[j, i]] += masses[j] * rows[i, a]
                if is_foot:
                    jacobians[1 if feet[0] == j else 2, a, movers[j, i]] = rows[i, a]
    left, right = positions[feet[0]], positions[feet[1]]
    centre_x, centre_y = centre[0] - left[0], centre[1] - left[1]
    stance_x, stance_y = right[0] - left[0], right[1] - left[1]
    square = max(stance_x * stance_x + stance_y * stance_y, 1e-9)
    fraction = (centre_x * stance_x + centre_y * stance_y) / square  # of the ankle line, at the nearest point
    free = 0.0 < fraction < 1.0
    clipped = min(max(fraction, 0.0), 1.0)
    forward_row, left_row = np.empty(n), np.empty(n)
    cos, sin = np.cos(pose[3]), np.sin(pose[3])
    error_x, error_y = centre_x - clipped * stance_x, centre_y - clipped * stance_y
    for p in range(n):
        d_centre_x, d_centre_y = jacobians[0, 0, p] - jacobians[1, 0, p], jacobians[0, 1, p] - jacobians[1, 1, p]
        d_x, d_y = jacobians[2, 0, p] - jacobians[1, 0, p], jacobians[2, 1, p] - jacobians[1, 1, p]
        d_fraction = 0.0
        if free:
            d_fraction = stance_x * d_centre_x + stance_y * d_centre_y
            d_fraction += (centre_x - 2.0 * fraction * stance_x) * d_x + (centre_y - 2.0 * fraction * stance_y) * d_y
            d_fraction /= square
        e_x = d_centre_x - clipped * d_x - stance_x * d_fraction
        e_y = d_centre_y - clipped * d_y - stance_y * d_fraction
        forward_row[p], left_row[p] = balance[2] * (cos * e_x + sin * e_y), balance[2] * (cos * e_y - sin * e_x)
    forward_row[3] += balance[2] * (cos * error_y - sin * error_x)
    left_row[3] += balance[2] * (-cos * error_x - sin * error_y)
    forward = (cos * error_x + sin * error_y - balance[0]) * balance[2]
    leftward = (cos * error_y - sin * error_x - balance[1]) * balance[2]
    cost = _add_row(forward, forward_row, _BALANCE, gradient, block)
    cost += _add_row(leftward, left_row, _BALANCE, gradient, block)
    if np.isfinite(ground[0]):
        foot = 1 if left[2] <= right[2] else 2
        residual = (min(left[2], right[2]) - ground[0]) * ground[1]
        for p in range(n):
            left_row[p] = ground[1] * jacobians[foot, 2, p]
        cost += _add_row(residual, left_row, _GROUND, gradient, block)
    return cost


@_inner
def _add_depths(
    t: Any, depths: Any, chain: Any, positions: Any, axes: Any, rows: Any, gradient: Any, block: Any
) -> Any:  # fmt: skip
    """Add frame t's bones that are less deep than by their landmarks; return their cost."""
    first, ends, directions, whitening, least = depths
    movers, n_movers, cost, row = chain[4], chain[5], 0.0, np.empty(len(gradient))
    for k in range(first[t], first[t + 1]):
        row[:] = 0.0
        residual = -least[k]
        for end, sign in ((ends[k, 0], -1.0), (ends[k, 1], 1.0)):
            joint_rows(end, chain, positions, axes, rows)
            for a in range(3):
                component = sign * directions[k, a]
                residual += component * positions[end, a]
                for i in range(n_movers[end]):
                    row[movers[end, i]] += whitening[k] * component * rows[i, a]
        if residual < 0.0:
            cost += _add_row(whitening[k] * residual, row, _DEPTH, gradient, block)
    return cost


@_inner
def _clear(gradient: Any, block: Any, joint_gradients: Any, joint_hessians: Any) -> None:
    for p in range(len(gradient)):
        gradient[p] = 0.0
        for q in range(len(gradient)):
            block[p, q] = 0.0
    for j in range(len(joint_gradients)):
        for a in range(3):
            joint_gradients[j, a] = 0.0
            for b in range(3):
                joint_hessians[j, a, b] = 0.0


@_inner
def _frame(
    t: Any, pose: Any, terms: Any, workspace: Any,
    gradient: Any, block: Any,
) -> Any:  # fmt: skip
    """Write gradient (P,) and the lower triangle of block (P, P) of one frame; return its cost. workspace: rotations
    (J, 3, 3), positions (J, 3), axes (P, 3), m (J, 3), M (J, 3, 3), rows (m, 3), which are overwritten."""
    chain, keypoints, loss, targets, prior, depths, stance = terms
    rotations, positions, axes, joint_gradients, joint_hessians, rows = workspace
    _clear(gradient, block, joint_gradients, joint_hessians)
    _kinematics(pose, chain, rotations, positions, axes)
    cost = _add_keypoints(t, keypoints, loss, positions, joint_gradients, joint_hessians)
    cost += _add_targets(t, targets, positions, joint_gradients, joint_hessians)
    for j in range(len(joint_gradients)):
        if joint_hessians[j, 0, 0] + joint_hessians[j, 1, 1] + joint_hessians[j, 2, 2] > 0.0:
            add_joint(j, chain, positions, axes, joint_gradients[j], joint_hessians[j], rows, gradient, block)
    cost += _add_pose_prior(t, pose, prior, gradient, block)
    cost += _add_depths(t, depths, chain, positions, axes, rows, gradient, block)
    return cost + _add_stance(pose, stance, chain, positions, axes, rows, gradient, block)


@kernel()
def expand_frames(
    poses: Any, first: Any, terms: Any, positions: Any,
    axes: Any, joint_hessians: Any, gradients: Any, blocks: Any,
) -> Any:  # fmt: skip
    """Write, for poses (n, P) of the frames from `first` on, positions (n, J, 3), axes (n, P, 3), M (n, J, 3, 3),
    gradients (n, P) and blocks (n, P, P); return the cost."""
    rotations, rows = np.empty((positions.shape[1], 3, 3)), np.empty((terms[0][4].shape[1], 3))
    joint_gradients, cost = np.empty((positions.shape[1], 3)), 0.0
    for i in range(len(poses)):
        workspace = (rotations, positions[i], axes[i], joint_gradients, joint_hessians[i], rows)
        cost += _frame(first + i, poses[i], terms, workspace, gradients[i], blocks[i])
    return cost


@kernel()
def add_foot_contacts(
    first: Any, frames: Any, joints: Any, whitening: Any, chain: Any, positions: Any, axes: Any,
    gradients: Any, blocks: Any, couplings: Any,
) -> Any:  # fmt: skip
    """Add foot contacts of joints (K,) from each of frames (K,) to the next: three residuals whitening (K,) · (x' − x)
    under the loss of a foot's drift; return the cost. positions (n, J, 3) and axes (n, P, 3) begin with frame `first`.
    couplings: (n, P, P), row of the next frame and column of this one, is added to."""
    movers, n_movers, cost = chain[4], chain[5], 0.0
    before, after = np.empty((chain[4].shape[1], 3)), np.empty((chain[4].shape[1], 3))
    for k in range(len(frames)):
        i, j = frames[k] - first, joints[k]
        joint_rows(j, chain, positions[i], axes[i], before)
        joint_rows(j, chain, positions[i + 1], axes[i + 1], after)
        for a in range(3):
            drift = whitening[k] * (positions[i + 1, j, a] - positions[i, j, a])
            rho, derivative, curvature = robust_terms(drift, _FOOT_DRIFT[0], _FOOT_DRIFT[1])
            cost += rho
            derivative, curvature = derivative * whitening[k], curvature * whitening[k] ** 2
            for m in range(n_movers[j]):
                p = movers[j, m]
                gradients[i, p] -= derivative * before[m, a]
                gradients[i + 1, p] += derivative * after[m, a]
                for n in range(n_movers[j]):
                    q = movers[j, n]
                    couplings[i, p, q] -= curvature * after[m, a] * before[n, a]
                    if n <= m:
                        blocks[i, p, q] += curvature * before[m, a] * before[n, a]
                        blocks[i + 1, p, q] += curvature * after[m, a] * after[n, a]
    return cost


@kernel()
def fill_band(blocks: Any, couplings: Any, band: Any, weights: Any, cells: Any) -> None:
    """Write the lower band (2 P + 1, n P) of blocks (n, P, P), of the couplings (n, P, P) of each frame with the next,
    and of the second differences: band (n, 3), see `PoseProblem`, times weights (P,) of each degree of freedom."""
    n, size = len(blocks), len(weights)
    for t in range(n):
        for q in range(size):
            column = t * size + q
            for k in range(2 * size + 1):
                cells[k, column] = 0.0
            for p in range(q, size):
                cells[p - q, column] = blocks[t, p, q]
            cells[0, column] += band[t, 0] * weights[q]
            if t + 1 < n:
                for p in range(size):
                    cells[size + p - q, column] = couplings[t, p, q]
                cells[size, column] += band[t, 1] * weights[q]
            if t + 2 < n:
                cells[2 * size, column] = band[t, 2] * weights[q]


@_inner
def _solve(matrix: Any, damping: Any, right_side: Any, root: Any, x: Any) -> Any:
    """Solve (A + diag(damping)) x = right_side by the Cholesky factor of a lower triangle A (n, n); return False if it
    is not positive definite."""
    n = len(right_side)
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
        total = right_side[i]
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
def _regularized_frame(
    t: Any, pose: Any, centre: Any, precision: Any, terms: Any,
    workspace: Any, gradient: Any, block: Any, damping_diagonal: Any,
) -> Any:  # fmt: skip
    """Expand one frame with a quadratic term of precision (P,) about the pose `centre` (P,), which is not damped;
    return the cost."""
    cost = _frame(t, pose, terms, workspace, gradient, block)
    for p in range(len(pose)):
        damping_diagonal[p] = block[p, p]
        block[p, p] += precision[p]
        gradient[p] += precision[p] * (pose[p] - centre[p])
        cost += 0.5 * precision[p] * (pose[p] - centre[p]) ** 2
    return cost


@_inner
def fit_one(
    t: Any, pose: Any, centre: Any, precision: Any, terms: Any, workspace: Any, max_iterations: Any, tolerance: Any
) -> Any:
    """Move `pose` (P,) to a minimum of frame t's cost by Levenberg and Marquardt's method, as `solver.minimise`; return
    that cost."""
    n = len(pose)
    gradients, blocks, diagonals = np.empty((2, n)), np.empty((2, n, n)), np.empty((2, n))  # current, new
    root, step, damping, candidate = np.empty((n, n)), np.empty(n), np.empty(n), np.empty(n)
    factor, growth, iterations, current = FIRST_DAMPING, 2.0, 0, 0
    cost = _regularized_frame(t, pose, centre, precision, terms, workspace, gradients[0], blocks[0], diagonals[0])
    while iterations < max_iterations and factor < MAX_DAMPING:
        gradient, max_diagonal, max_slope = gradients[current], 0.0, 0.0
        for p in range(n):
            max_diagonal, max_slope = max(max_diagonal, diagonals[current, p]), max(max_slope, abs(gradient[p]))
        if max_slope == 0.0:
            break
        for p in range(n):
            damping[p] = factor * max(diagonals[current, p], 1e-9 * max_diagonal)
        if not _solve(blocks[current], damping, gradient, root, step):
            factor, growth = factor * growth, 2.0 * growth
            continue
        predicted_decrease = 0.0
        for p in range(n):
            predicted_decrease += 0.5 * step[p] * (damping[p] * step[p] + gradient[p])
            candidate[p] = pose[p] - step[p]
        if predicted_decrease <= tolerance * cost:
            break
        new = 1 - current
        candidate_cost = _regularized_frame(
            t, candidate, centre, precision, terms, workspace, gradients[new], blocks[new], diagonals[new]
        )
        iterations += 1
        gain = (cost - candidate_cost) / predicted_decrease
        if gain > 0.0:
            for p in range(n):
                pose[p] = candidate[p]
            cost, current = candidate_cost, new
            factor, growth = factor * max(1.0 / 3.0, 1.0 - (2.0 * gain - 1.0) ** 3), 2.0
        else:
            factor, growth = factor * growth, 2.0 * growth
    return cost


@kernel()
def fit_frames(
    poses: Any, follow: bool, precisions: Any, terms: Any, max_iterations: Any, tolerance: Any, costs: Any,
) -> None:  # fmt: skip
    """Fit poses (T, P), each frame alone, with a quadratic term of precisions (T, P) about the initial pose: its own
    one, or with `follow` the fitted pose of the previous frame. Writes the costs (T,)."""
    n_joints, n = len(terms[0][0]), poses.shape[1]
    workspace = (
        np.empty((n_joints, 3, 3)), np.empty((n_joints, 3)), np.empty((n, 3)), np.empty((n_joints, 3)),
        np.empty((n_joints, 3, 3)), np.empty((terms[0][4].shape[1], 3)),
    )  # fmt: skip
    centre = np.empty(n)
    for t in range(len(poses)):
        for p in range(n):
            if follow and t > 0:
                poses[t, p] = poses[t - 1, p]
            centre[p] = poses[t, p]
        costs[t] = fit_one(t, poses[t], centre, precisions[t], terms, workspace, max_iterations, tolerance)
