"""How alike a detector of 2-D joints errs in frames that follow each other, and how many frames that leaves."""

from collections.abc import Sequence
from itertools import pairwise

import numpy as np

from workbench.body.skeleton import Skeleton
from workbench.core.observations import Observed
from workbench.core.residual import keypoint_residual
from workbench.utils.arrays import FloatArray

MOST_APART_S = 0.1
"""Frames further apart are not compared."""
FAR = 4.0
LEAST_PAIRS = 100
"""Errors to compare; fewer tell nothing."""


def error_correlation(
    skeleton: Skeleton, seen: Sequence[Observed], times_s: FloatArray, poses: FloatArray, sigma_px: float
) -> float:
    """Estimate the correlation ρ between a joint's errors in frames that follow each other, at poses (T, P).

    Errors beyond FAR robust deviations, of joints that were taken for others, are left out. Zero where it is within two
    standard errors of none, 1 / √n for n pairs, and where there are too few pairs.
    """
    residuals = [_errors(skeleton, frame, pose, sigma_px) for frame, pose in zip(seen, poses, strict=True)]
    pairs = [
        (first[mark], then[mark])
        for (first, then), gap in zip(pairwise(residuals), np.diff(times_s), strict=True)
        if gap <= MOST_APART_S
        for mark in first
        if mark in then
    ]
    before, after = np.array(pairs).reshape(-1, 2, 2).transpose(1, 0, 2)
    if before.size < LEAST_PAIRS:
        return 0.0
    far = FAR * 1.4826 * float(np.median(np.abs(before)))
    near = (np.abs(before) < far) & (np.abs(after) < far)
    before, after = before[near], after[near]
    rho = float((before * after).sum() / np.sqrt((before**2).sum() * (after**2).sum()))
    return rho if rho > 2.0 / np.sqrt(before.size) else 0.0


def effective_share(rho: float) -> float:
    """Tell what part of the frames counts, (1 − ρ) / (1 + ρ): as many independent ones determine a mean as well as many
    whose errors are a first-order autoregression with correlation ρ."""
    return (1.0 - rho) / (1.0 + rho)


def _errors(
    skeleton: Skeleton, frame: Observed, pose: FloatArray, sigma_px: float
) -> dict[tuple[str, int], FloatArray]:
    """Give the whitened errors (2,) of one frame's joints in each view, by camera and joint."""
    errors: dict[tuple[str, int], FloatArray] = {}
    for view in frame.keypoints:
        misses, _ = keypoint_residual(skeleton, view.camera, view.joints, view.marks, sigma_px)(pose)
        rows = misses.reshape(-1, 2)
        errors |= {(view.camera.name, int(joint)): error for joint, error in zip(view.joints, rows, strict=True)}
    return errors
