"""Systematic errors of points, limb lengths, cameras and detectors, which many observations share and which do not
average out."""

from collections.abc import Sequence
from dataclasses import replace
from itertools import pairwise

import numpy as np

from workbench.body.skeleton import Skeleton, without_side
from workbench.core.observations import Observed
from workbench.core.residual import keypoint_residual
from workbench.inference.least_squares.video.pose_problem import PoseProblem
from workbench.utils.arrays import FloatArray, IntArray

_DERIVATIVE_STEP = 1e-4
"""In standard deviations of a camera: residuals change by less than their own standard deviation."""
DEFAULT_LENGTH_SIGMA = 0.02
"""Relative standard deviation of a bone length of unknown accuracy, that of a measuring tape."""


def default_length_uncertainty(skeleton: Skeleton) -> FloatArray:
    """Return the offset errors (J, 3, G), m, for one standard deviation, DEFAULT_LENGTH_SIGMA, of each bone's relative
    length, equal on both sides."""
    bones = [without_side(name) for name in skeleton.names]
    causes = list(dict.fromkeys(bones))
    same_bone = np.array([[bone == cause for cause in causes] for bone in bones], dtype=np.float64)
    return np.asarray(DEFAULT_LENGTH_SIGMA * skeleton.offsets[:, :, None] * same_bone[:, None, :])


def estimated_camera_sensitivity(problem: PoseProblem, poses: FloatArray, uncertainty: FloatArray) -> FloatArray:
    """Return the error (T, P, G) of fitted poses (T, P) for one standard deviation of each error of an only camera.

    It is −H⁻¹ Jᵀ W ∂r/∂e with the residuals r, their Jacobian J and weights W, and the Gauss–Newton matrix H of the
    problem without a known ground: the height of the ground is estimated from the same images and moves with the
    person. If the focal length is 10 % too long, the person is 10 % too far away, however many frames there are.

    Parameters
    ----------
    uncertainty : (G, C, 23), changes of the keypoints' rows, see `Camera`.
    """
    problem, keypoints, gradients = replace(problem, ground_m=None), problem.keypoints, []
    for change in _DERIVATIVE_STEP * uncertainty:
        ahead, behind = (replace(keypoints, rows=keypoints.rows + sign * change) for sign in (1.0, -1.0))
        moved = replace(problem, keypoints=ahead).residuals(poses) - replace(problem, keypoints=behind).residuals(poses)
        moved_px = 0.5 * moved / keypoints.whitening[:, None]
        sides = (replace(keypoints, pixels=keypoints.pixels + sign * moved_px) for sign in (1.0, -1.0))
        less, more = (replace(problem, keypoints=side).expand(poses.ravel()).gradient for side in sides)
        gradients.append((less - more) / (2.0 * _DERIVATIVE_STEP))
    factor = problem.expand(poses.ravel()).normal.factor()
    return factor.solve(np.stack(gradients, axis=1)).reshape(*poses.shape, -1)


MAX_GAP_S = 0.1
"""Largest time between two compared frames."""
OUTLIER_DEVIATIONS = 4.0
MIN_PAIRS = 100
"""Smallest number of compared errors."""


def error_correlation(
    skeleton: Skeleton, observations: Sequence[Observed], times_s: FloatArray, poses: FloatArray, sigma_px: float
) -> float:
    """Return the correlation ρ between a joint's errors in consecutive frames at poses (T, P).

    Errors beyond OUTLIER_DEVIATIONS robust standard deviations, of confused joints, are omitted. Returns zero for fewer
    than MIN_PAIRS errors, and where ρ is below two standard errors, 1 / √n for n pairs.
    """
    residuals = [_errors(skeleton, frame, pose, sigma_px) for frame, pose in zip(observations, poses, strict=True)]
    pairs = [
        (first[joint], second[joint])
        for (first, second), gap in zip(pairwise(residuals), np.diff(times_s), strict=True)
        if gap <= MAX_GAP_S
        for joint in first
        if joint in second
    ]
    before, after = np.array(pairs).reshape(-1, 2, 2).transpose(1, 0, 2)
    if before.size < MIN_PAIRS:
        return 0.0
    limit = OUTLIER_DEVIATIONS * 1.4826 * float(np.median(np.abs(before)))
    inliers = (np.abs(before) < limit) & (np.abs(after) < limit)
    before, after = before[inliers], after[inliers]
    rho = float((before * after).sum() / np.sqrt((before**2).sum() * (after**2).sum()))
    return rho if rho > 2.0 / np.sqrt(before.size) else 0.0


def effective_fraction(rho: float) -> float:
    """Return the effective fraction of the frames, (1 − ρ) / (1 + ρ): so many independent frames determine a mean as
    well as all frames with first-order autoregressive errors of correlation ρ."""
    return (1.0 - rho) / (1.0 + rho)


def integrated_autocorrelation(residuals: FloatArray, series: IntArray, frames: IntArray) -> float:
    """Return the integrated autocorrelation time 1 + 2 Σ_k ρ_k, in frames, of residuals (K, 2).

    n frames determine a mean as well as n over this number of independent frames. ρ_k is the correlation of residuals
    of the same series in frames k apart. The sum ends with the first ρ_k below two standard errors, 1 / √n for n pairs,
    and where fewer than MIN_PAIRS remain; it is 1 for independent residuals. Outliers are omitted as in
    `error_correlation`.

    Parameters
    ----------
    residuals : (K, 2), of zero median.
    series : (K,) number of a residual's series, such as one joint in one camera.
    frames : (K,) index of its frame.
    """
    inliers = (np.abs(residuals) < OUTLIER_DEVIATIONS * 1.4826 * np.median(np.abs(residuals))).all(axis=1)
    residuals, series, frames = residuals[inliers], series[inliers], frames[inliers]
    n_frames, time = int(frames.max(initial=0)) + 1, 1.0
    keys = series * 2 * n_frames + frames  # a frame k later has the key + k, and no two series overlap
    order = np.argsort(keys)
    keys, residuals = keys[order], residuals[order]
    for lag in range(1, n_frames):
        later = np.searchsorted(keys, keys + lag).clip(max=len(keys) - 1)
        pairs = keys[later] == keys + lag
        before, after = residuals[pairs], residuals[later[pairs]]
        if before.size < MIN_PAIRS:
            break
        rho = float((before * after).sum() / np.sqrt((before**2).sum() * (after**2).sum()))
        if not rho > 2.0 / np.sqrt(before.size):
            break
        time += 2.0 * rho
    return time


def _errors(
    skeleton: Skeleton, frame: Observed, pose: FloatArray, sigma_px: float
) -> dict[tuple[str, int], FloatArray]:
    """Return the whitened errors (2,) of one frame's joints in each view, by camera and joint."""
    errors: dict[tuple[str, int], FloatArray] = {}
    for view in frame.keypoints:
        residuals, _ = keypoint_residual(skeleton, view.camera, view.joints, view.detections, sigma_px)(pose)
        rows = residuals.reshape(-1, 2)
        errors |= {(view.camera.name, int(joint)): error for joint, error in zip(view.joints, rows, strict=True)}
    return errors
