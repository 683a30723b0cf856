"""Poses of all frames at once that move smoothly and stay within the body's limits: least squares without a motion
model, where what is seen of every frame alone does not tell its pose, as by one camera."""

from collections.abc import Sequence

import numpy as np
from tqdm import tqdm

from workbench.arrays import FloatArray
from workbench.body.skeleton import N_ROOT, Skeleton
from workbench.inference.decoding import PoseDecoder
from workbench.inference.frame_fit import PACE_HZ, Gaussian, Smoothness, fit_frame
from workbench.inference.levenberg_marquardt import Minimum
from workbench.inference.motion_fit import FitProblem, fit_motion, second_differences
from workbench.inference.observed import Keypoints, views_residual
from workbench.inference.residuals import Loss, Residual, limit_residual, robust, stacked
from workbench.inference.start import likely_poses

LIMIT_SIGMA_RAD = 0.05
REST_SIGMA_RAD = 1.0
"""Of a joint angle about zero, the neutral pose: for angles that nothing shows, such as the twist of a straight arm."""
FOLLOW_SIGMA = 0.5
"""m and rad at PACE_HZ: how far from the frame before a pose is looked for at first."""
SQUARED = Loss("squared", 1.0)
FAR_LOSS = Loss("huber", 3.0)
LEANING_SIGMA_RAD = 0.6
"""Of pitch and roll of people who do anything."""
N_HYPOTHESES = 3
"""Poses of the first frame that are followed: one camera does not tell forwards from backwards."""


def fit_smooth(
    skeleton: Skeleton,
    residuals: Sequence[Residual],
    times_s: FloatArray,
    loss: Loss,
    starts: FloatArray,
    smoothness: Smoothness,
    max_iterations: int,
) -> tuple[FloatArray, FloatArray, Minimum]:
    """Poses (T, P) with their marginal covariances (T, P, P), and the search.

    Minimises Σ_t Σ_k ρ(r_tk) + limits + ½ Σ_t |angles / REST_SIGMA_RAD|² + the smoothness's second differences, which
    is the smooth prior of paper A (section 6.1) over all frames at once. It starts from poses (n, P) in the first
    frame, of which the one wins that all frames together like best, and what is then found frame by frame, at first
    with a loss that sees any distance: an arm that one which redescends has lost in one frame would be an outlier in
    all that follow.
    """
    poses, _ = candidates(skeleton, residuals, times_s, starts, smoothness, max_iterations)[0]
    problem = smooth_problem(PoseDecoder(skeleton), bounded(skeleton, residuals, loss), times_s, smoothness)
    return fit_motion(problem, poses, max_iterations=max_iterations)


def candidates(
    skeleton: Skeleton,
    residuals: Sequence[Residual],
    times_s: FloatArray,
    starts: FloatArray,
    smoothness: Smoothness,
    max_iterations: int,
) -> list[tuple[FloatArray, float]]:
    """Poses (T, P) and their cost under FAR_LOSS, from each of the poses `starts` (n, P), the likeliest first."""
    decoder, near = PoseDecoder(skeleton), bounded(skeleton, residuals, FAR_LOSS)
    problem, found = smooth_problem(decoder, near, times_s, smoothness), []
    for start in starts:
        poses = _follow(decoder, near, times_s, start)
        poses, _, minimum = fit_motion(problem, poses, max_iterations=max_iterations, tolerance=1e-3)
        found.append((poses, minimum.costs[-1]))
    return sorted(found, key=lambda one: one[1])


def bounded(skeleton: Skeleton, residuals: Sequence[Residual], loss: Loss) -> list[Residual]:
    """With the loss of what is seen, and the limits beside it, which no loss forgives."""
    limits = limit_residual(skeleton, LIMIT_SIGMA_RAD)
    return [stacked([robust(one, loss), limits]) for one in residuals]


def first_poses(skeleton: Skeleton, seen: Sequence[Keypoints], sigma_px: float) -> FloatArray:
    """Poses (n ≤ N_HYPOTHESES, P) within limits that one frame of keypoints allows."""
    residual = views_residual(skeleton, seen, sigma_px, LEANING_SIGMA_RAD)
    sigma = np.full(len(skeleton.dof_names), REST_SIGMA_RAD)
    sigma[:N_ROOT] = np.inf
    rest = Gaussian.independent(np.zeros(len(sigma)), sigma)
    within = stacked([residual, limit_residual(skeleton, LIMIT_SIGMA_RAD)])
    return likely_poses(skeleton, seen, within, rest, N_HYPOTHESES)


def smooth_problem(
    decoder: PoseDecoder, residuals: Sequence[Residual], times_s: FloatArray, smoothness: Smoothness
) -> FitProblem:
    """The problem of T frames at times (T,), s, in which every frame has a pose of its own."""
    n_frames, n_dofs = len(residuals), len(decoder.space)
    columns = np.arange(n_frames * n_dofs).reshape(n_frames, n_dofs)
    angles = columns[:, N_ROOT:].ravel()
    rows = second_differences(columns, PACE_HZ * times_s, pose_deviations(smoothness, n_dofs))
    rows += [(np.array([column]), np.array([1.0 / REST_SIGMA_RAD])) for column in angles]
    return FitProblem.of(decoder, residuals, SQUARED, columns, rows, n_border=0)


def pose_deviations(smoothness: Smoothness, n_dofs: int) -> FloatArray:
    """(P,), of second differences of the pose at PACE_HZ."""
    return np.array([*smoothness.second_differences[1:], *[smoothness.angle] * (n_dofs - N_ROOT)])


def _follow(decoder: PoseDecoder, residuals: Sequence[Residual], times_s: FloatArray, start: FloatArray) -> FloatArray:
    """Poses (T, P), each near the one before."""
    poses = [start]
    gaps = np.diff(times_s, prepend=times_s[0] - 1.0 / PACE_HZ)
    for t in tqdm(range(len(residuals)), desc="following", unit="frame", disable=None, leave=False):
        spread = np.full(len(start), FOLLOW_SIGMA * np.sqrt(PACE_HZ * gaps[t]))
        prior = Gaussian.independent(poses[-1], spread)
        poses.append(fit_frame(decoder, residuals[t], SQUARED, poses[-1], prior=prior).x)
    return np.array(poses[1:])
