"""Errors of a detector's joints, which do not average out over frames and cameras, in the covariances of a smooth fit.

Least squares treats errors of keypoints as independent. A detector's are not: it has its own definition of each joint,
which is constant over a clip; the remaining errors last for many frames; and a camera whose calibration or
synchronisation is inaccurate displaces all joints of its view. The poses are those of independent errors; only their
covariances change.
"""

from dataclasses import replace

import numpy as np

from workbench.body.kinematics import forward, joint_jacobian
from workbench.body.skeleton import POSE_NAMES, Skeleton
from workbench.inference.least_squares.solver.motion_posterior import MotionPosterior, SystematicErrors
from workbench.inference.least_squares.solver.sparse_solver import Factor
from workbench.inference.least_squares.video.pose_problem import PoseProblem
from workbench.inference.least_squares.video.systematic_errors import integrated_autocorrelation
from workbench.utils.arrays import FloatArray, IntArray

OFFSET_STD_M, EXTREMITY_OFFSET_STD_M = 0.033, 0.013
"""Standard deviation of a joint's definition along each axis, and that of EXTREMITIES.

Detected hips and knees are 30 to 50 mm from those of markers, ankles up to 15 mm (Needham et al., Scientific Reports
11, 2021). 40 and 16 mm are 23 and 9 mm along each axis; annotations of a woman by hand differ as much from a detector's
joints: 18 mm, and 9 mm at wrists and ankles. Heels and toes are taken for as distinct as ankles. The
factor √2 is for the reference that a joint is compared with, such as another detector, whose definition differs
independently."""
EXTREMITIES = ("wrist", "ankle", "heel", "toes")
_ROBUST_STD = 1.4826
"""Standard deviation of a normal distribution over its median absolute deviation."""


def with_detector_errors(
    posterior: MotionPosterior, problem: PoseProblem, poses: FloatArray, factor: Factor
) -> MotionPosterior:
    """Return a posterior of independent errors of keypoints with a detector's errors instead.

    Its noise is that of the standard deviations times `noise_scales`, an upper bound, as it takes the noise at all
    frequencies for as strong as at the lowest. The nominal angles have the power of as many independent frames, since
    poses in neighbouring frames are dependent, too; those of feet have a power of their own. The joints' definitions,
    see `offset_sensitivity`, and the cameras' displacements, see `camera_sensitivity`, are systematic errors.

    Parameters
    ----------
    posterior : of a fit to the problem.
    poses : (T, P), the problem's minimum.
    factor : of its Gauss–Newton matrix there.
    """
    scales, n_correlated = noise_scales(problem, poses)
    keypoints = replace(problem.keypoints, whitening=problem.keypoints.whitening / scales)
    mean, precision = map(np.copy, problem.nominal)
    angles = slice(len(POSE_NAMES))
    precision[angles, angles] /= n_correlated
    noisy = replace(problem, keypoints=keypoints, pose_prior=(mean[None], precision[None]))
    causes = (offset_sensitivity(problem, factor, poses), camera_sensitivity(problem, factor, poses))
    noise = noisy.expand(poses.ravel()).normal.factor()
    return replace(posterior, noise=noise).including(*map(SystematicErrors, causes))


def offset_std(skeleton: Skeleton) -> FloatArray:
    """Return the standard deviations (J,) of the joints' definitions along each axis, m."""
    at_end = [any(name.endswith(joint) for joint in EXTREMITIES) for name in skeleton.names]
    return np.where(at_end, EXTREMITY_OFFSET_STD_M, OFFSET_STD_M)


def offset_sensitivity(problem: PoseProblem, factor: Factor, poses: FloatArray) -> FloatArray:
    """Return the error (T, P, 3 J) of fitted poses (T, P) for one standard deviation of each joint's definition along
    each axis of its parent's frame, in which it is constant, since landmarks are defined on bones.

    It is H⁻¹ Σ_t D_jᵀ M_j R_parent(j) σ_j with D_j the joint's Jacobian and M_j the information about its position.

    Parameters
    ----------
    factor : of the Gauss–Newton matrix H at the poses.
    """
    skeleton = problem.skeleton
    axes = forward(skeleton, poses).rotations[:, skeleton.parents.clip(min=0)] * offset_std(skeleton)[:, None, None]
    information = problem.joint_information(poses)
    right = np.einsum("tjxp,tjxy,tjya->tpja", joint_jacobian(skeleton, poses), information, axes, optimize=True)
    return factor.solve(right.reshape(poses.size, -1)).reshape(*poses.shape, -1)


def camera_sensitivity(problem: PoseProblem, factor: Factor, poses: FloatArray) -> FloatArray:
    """Return the error (T, P, 2 C) of fitted poses (T, P) for one standard deviation of each camera's displacement
    along each axis of its image.

    The standard deviation is estimated from the residuals: each camera's median over all joints and frames b_c (2,),
    σ² = Σ_c |b_c|² / (2 C − 3) with C cameras, because the person's position fits three of these numbers. The
    displacement of a single camera displaces the scene and has no residuals; the sensitivity is empty.

    Parameters
    ----------
    factor : of the Gauss–Newton matrix at the poses.
    """
    keypoints = problem.keypoints
    cameras = np.unique(keypoints.views)
    if len(cameras) < 2:
        return np.zeros((*poses.shape, 0))
    residuals_px = problem.residuals(poses) / keypoints.whitening[:, None]
    medians = [np.median(residuals_px[keypoints.views == camera], axis=0) for camera in cameras]
    sigma_px = np.sqrt(np.square(medians).sum() / (2 * len(cameras) - 3))
    gradient, changes = problem.expand(poses.ravel()).gradient, []
    for camera in cameras:
        for axis in sigma_px * np.eye(2):
            pixels = keypoints.pixels + np.outer(keypoints.views == camera, axis)
            displaced = replace(problem, keypoints=replace(keypoints, pixels=pixels))
            changes.append(gradient - displaced.expand(poses.ravel()).gradient)
    return factor.solve(np.stack(changes, axis=1)).reshape(*poses.shape, -1)


def noise_scales(problem: PoseProblem, poses: FloatArray) -> tuple[FloatArray, float]:
    """Return the factors (K,) of the keypoints' standard deviations that make their information that of as many
    independent errors, and the number of frames with the information of one such, from the residuals at poses (T, P).

    A factor is the joint's robust standard deviation of whitened residuals, at least 1, since the fit of one camera
    absorbs most errors, times the root of the `integrated_autocorrelation`. The constant displacement of a joint in a
    camera, the median of its residuals, is subtracted.
    """
    keypoints, residuals, n_joints = problem.keypoints, problem.residuals(poses), len(problem.skeleton.names)
    series = keypoints.views * n_joints + keypoints.joints
    residuals = residuals - _medians(residuals, series, int(series.max(initial=0)) + 1)[series]
    scales = _ROBUST_STD * _medians(np.abs(residuals), keypoints.joints, n_joints).mean(axis=1)
    frames = np.repeat(np.arange(problem.n_frames), np.diff(keypoints.first))
    n_correlated = integrated_autocorrelation(residuals, series, frames)
    return np.asarray(scales.clip(min=1.0)[keypoints.joints] * np.sqrt(n_correlated)), n_correlated


def _medians(values: FloatArray, groups: IntArray, n_groups: int) -> FloatArray:
    """Return the medians (n_groups, 2) of values (K, 2) in groups (K,); 0 for an empty group."""
    order = np.argsort(groups, kind="stable")
    ends = np.cumsum(np.bincount(groups, minlength=n_groups))[:-1]
    members = np.split(values[order], ends)
    return np.array([np.median(group, axis=0) if len(group) else np.zeros(2) for group in members])
