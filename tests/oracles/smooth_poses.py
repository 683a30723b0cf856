"""The objective of smooth poses in plain NumPy, term by term, for `least_squares.video.pose_problem`."""

import numpy as np

from workbench.body.centre_of_mass import centre_of_mass
from workbench.body.kinematics import forward, joint_jacobian
from workbench.body.skeleton import JOINT_NAMES
from workbench.core.losses import BALANCE_LOSS, FOOT_DRIFT_LOSS, GROUND_LOSS
from workbench.core.residual import no_residuals, robust
from workbench.inference.least_squares.solver.residuals import nominal_pose_prior


def expansion(problem, residuals, poses):
    """Return the cost of a `PoseProblem` without depths at poses (T, P), its gradient (T P,), its Gauss–Newton matrix
    (T P, T P), and the diagonal (T P,) of the matrix without the smoothness.

    Parameters
    ----------
    residuals : one residual function per frame, instead of the problem's keypoints and residual functions.
    """
    columns = np.arange(poses.size).reshape(poses.shape)
    terms = [
        (columns[t], *residual(poses[t]))
        for t, frame_residual in enumerate(residuals)
        for residual in (robust(frame_residual, problem.loss), *constraints(problem, t))
    ]
    drifts = foot_drifts(problem.skeleton, problem.foot_contacts, problem.times_s)
    terms += [(columns[t : t + 2].ravel(), *drift(poses[t : t + 2].ravel())) for t, drift in drifts]
    cost, gradient, matrix = _sum(terms, poses.size)
    smoothness = _sum(second_differences(problem, poses, columns), poses.size)
    return cost + smoothness[0], gradient + smoothness[1], matrix + smoothness[2], np.diagonal(matrix)


def _sum(terms, size):
    """Return ½ Σ r², its gradient and Gauss–Newton matrix of terms: columns (n,), residuals (K,), Jacobian (K, n)."""
    cost, gradient, matrix = 0.0, np.zeros(size), np.zeros((size, size))
    for columns, values, jacobian in terms:
        cost += 0.5 * values @ values
        gradient[columns] += jacobian.T @ values
        matrix[np.ix_(columns, columns)] += jacobian.T @ jacobian
    return cost, gradient, matrix


def constraints(problem, t):
    """Return the residual functions of the pose in frame t: limits, pose prior, balance, ground."""
    skeleton = problem.skeleton
    functions = [limit_residual(skeleton, 0.05)]
    if problem.pose_prior is None:
        functions.append(nominal_pose_residual(skeleton))
    else:
        functions.append(gaussian_residual(problem.pose_prior[0][t], problem.pose_prior[1][t]))
    if set(JOINT_NAMES) <= set(skeleton.names):
        functions.append(robust(balance_residual(skeleton), BALANCE_LOSS))
        if problem.ground_m is not None:
            functions.append(robust(ground_residual(skeleton, problem.ground_m), GROUND_LOSS))
    return functions


def second_differences(problem, poses, columns):
    """Return the terms of the second differences of all parameters, whose time unit is 1/14 s."""
    root = problem.smoothness.second_differences[1:]
    deviations = np.array([*root, *map(problem.smoothness.of_angle, problem.skeleton.dof_names[len(root) :])])
    times, terms = 14.0 * problem.times_s, []
    for t in range(1, len(poses) - 1):
        before, after = 1.0 / np.diff(times[t - 1 : t + 2])
        weights = np.array([before, -before - after, after]) / np.sqrt(0.5 * (times[t + 1] - times[t - 1]))
        jacobian = np.hstack([np.diag(weight / deviations) for weight in weights])
        terms.append((columns[t - 1 : t + 2].ravel(), jacobian @ poses[t - 1 : t + 2].ravel(), jacobian))
    return terms


def foot_drifts(skeleton, foot_contacts, times_s):
    """Return the first frame and the residual, of two poses (2 P,), of each contact (T, 2) of the left or right ankle
    that lasts from one frame to the next, at most 0.5 s later: its displacement over 13 mm √s."""
    drifts = []
    for t, gap in enumerate(np.diff(times_s)):
        for k, name in enumerate(("left_ankle", "right_ankle")):
            if gap <= 0.5 and foot_contacts[t : t + 2, k].all():
                drifts.append((t, robust(_drift_residual(skeleton, name, 0.013 * np.sqrt(gap)), FOOT_DRIFT_LOSS)))
    return drifts


def _drift_residual(skeleton, joint, sigma_m):
    j = skeleton.joint(joint)

    def residual(pair):
        poses = pair.reshape(2, -1)
        positions, jacobian = forward(skeleton, poses).positions[:, j], joint_jacobian(skeleton, poses)[:, j]
        return (positions[1] - positions[0]) / sigma_m, np.hstack([-jacobian[0], jacobian[1]]) / sigma_m

    return residual


def joint_residual(skeleton, joints, points, sigma_m):
    """Return the residual of joints (K,) from 3-D points (K, 3), m; 3 K values."""
    if not len(points):
        return no_residuals

    def residual(pose):
        offsets = forward(skeleton, pose[None]).positions[0, joints] - points
        jacobian = joint_jacobian(skeleton, pose[None])[0, joints]
        return offsets.ravel() / sigma_m, jacobian.reshape(offsets.size, -1) / sigma_m

    return residual


def limit_residual(skeleton, sigma_rad):
    """Return the residual of angles beyond the skeleton's limits; zero within them."""
    lower, upper = skeleton.limits.T

    def residual(pose):
        beyond = pose - np.clip(pose, lower, upper)
        return beyond / sigma_rad, np.diag(beyond != 0.0) / sigma_rad

    return residual


def nominal_pose_residual(skeleton):
    """Return the residual of joint angles, pitch and roll from their nominal values."""
    nominal = nominal_pose_prior(skeleton)
    rows = nominal.whitening[4:]
    return lambda pose: (rows @ (pose - nominal.mean), rows)


def gaussian_residual(mean, precision):
    """Return the residual of a pose under N(mean (P,), precision⁻¹ (P, P)); parameters of zero precision are free."""
    rows = np.flatnonzero(np.diagonal(precision))
    jacobian = np.zeros((len(rows), len(mean)))
    jacobian[:, rows] = np.linalg.cholesky(precision[np.ix_(rows, rows)]).T
    return lambda pose: (jacobian @ (pose - mean), jacobian)


def balance_residual(skeleton):
    """Return the residual of the centre of mass from its nominal position, 43 mm ahead of the line between the ankles,
    over 50 mm."""
    masses, left, right = centre_of_mass(skeleton.names), skeleton.joint("left_ankle"), skeleton.joint("right_ankle")

    def residual(pose):
        positions = forward(skeleton, pose[None]).positions[0, :, :2]
        jacobian = joint_jacobian(skeleton, pose[None])[0, :, :2]
        offset, d_offset = masses @ positions - positions[left], np.tensordot(masses, jacobian, 1) - jacobian[left]
        stance, d_stance = positions[right] - positions[left], jacobian[right] - jacobian[left]
        square = max(float(stance @ stance), 1e-9)
        fraction = float(offset @ stance) / square  # of the ankle line, at the nearest point
        d_fraction = (stance @ d_offset + (offset - 2.0 * fraction * stance) @ d_stance) / square
        if not 0.0 < fraction < 1.0:
            fraction, d_fraction = min(max(fraction, 0.0), 1.0), np.zeros(len(pose))
        error, d_error = offset - fraction * stance, d_offset - fraction * d_stance - np.outer(stance, d_fraction)
        cos, sin = np.cos(pose[3]), np.sin(pose[3])
        to_heading = np.array([[cos, sin], [-sin, cos]])  # world axes to heading axes
        slope = to_heading @ d_error
        slope[:, 3] += np.array([[-sin, cos], [-cos, -sin]]) @ error
        return (to_heading @ error - [0.043, 0.0]) / 0.05, slope / 0.05

    return residual


def ground_residual(skeleton, ground_m):
    """Return the residual of the lower ankle's height from `ground_m`, over 30 mm."""
    ankles = np.array([skeleton.joint("left_ankle"), skeleton.joint("right_ankle")])

    def residual(pose):
        heights = forward(skeleton, pose[None]).positions[0, ankles, 2]
        lower = ankles[int(np.argmin(heights))]
        slope = joint_jacobian(skeleton, pose[None])[0, lower, 2:]
        return (heights.min(keepdims=True) - ground_m) / 0.03, slope / 0.03

    return residual
