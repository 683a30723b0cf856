"""Distances between estimated and true joints, in space and in the image; joints that are not known (NaN) are left out.

Estimates and truths are (..., J, D): D is 3 (m) or 2 (px), J the joints that are measured; every function averages over
the joints and keeps what is before them. Sources: HumanEva's errors are of Sigal, Balan & Black, IJCV 87 (2010), eq. 4
and 5; what else is named is what the field reports by that name.
"""

import numpy as np

from workbench.utils.arrays import FloatArray

PCK_M = 0.15
"""Threshold of the percentage of correct keypoints in space (Mehta et al., 3DV 2017): half a head's height."""
LEAST_FOR_PROCRUSTES = 4
"""Joints below which a similarity explains nearly anything."""


def mean_distance(estimate: FloatArray, truth: FloatArray) -> FloatArray:
    """Return the mean distance (...), in the unit given, NaN where no joint is known: MPJPE, which is HumanEva's 3-D
    error (eq. 4) over its 15 virtual markers, and its 2-D error (eq. 5) for pixels."""
    return _mean(np.linalg.norm(estimate - truth, axis=-1))


def procrustes(estimate: FloatArray, truth: FloatArray) -> float:
    """Return the mean distance, m, of joints (J, 3) after the similarity (turn, shift, scale) that brings them nearest
    in the mean square (Umeyama 1991): PA-MPJPE. NaN for joints all in one place or fewer than LEAST_FOR_PROCRUSTES."""
    known = np.isfinite(truth).all(axis=1)
    if known.sum() < LEAST_FOR_PROCRUSTES:
        return float("nan")
    centred, true = estimate[known] - estimate[known].mean(axis=0), truth[known] - truth[known].mean(axis=0)
    size = float((centred**2).sum())
    if size == 0.0:
        return float("nan")
    left, singular, right = np.linalg.svd(true.T @ centred)
    proper = np.array([1.0, 1.0, np.sign(np.linalg.det(left @ right))])  # a turn, not a mirror
    rotation, scale = (left * proper) @ right, float((singular * proper).sum()) / size
    return float(mean_distance(scale * centred @ rotation.T, true))


def correct_keypoints(estimate: FloatArray, truth: FloatArray, threshold: float) -> FloatArray:
    """Return PCK, the fraction (...) of known joints nearer than `threshold`, in the unit given, or NaN."""
    apart = np.linalg.norm(estimate - truth, axis=-1)
    return _mean(np.where(np.isnan(apart), np.nan, apart < threshold))


def acceleration_error(estimate: FloatArray, truth: FloatArray, times_s: FloatArray) -> FloatArray:
    """Return the mean distance (F − 2,), m/s², between the accelerations of joints (F, J, 3) in frames at times (F,),
    s. Frames may be uneven: accelerations are second divided differences, which are exact for parabolas."""
    return mean_distance(accelerations(estimate, times_s), accelerations(truth, times_s))


def accelerations(places: FloatArray, times_s: FloatArray) -> FloatArray:
    """Return second derivatives (F − 2, J, 3), m/s², of places (F, J, 3), m, at times (F,), s, rising."""
    gaps = np.diff(times_s)[:, None, None]
    velocities = np.diff(places, axis=0) / gaps
    return 2.0 * np.diff(velocities, axis=0) / (gaps[1:] + gaps[:-1])


def geodesic_deg(estimate: FloatArray, truth: FloatArray) -> FloatArray:
    """Return angles (...), degrees, of the turns between rotations (..., 3, 3): the geodesic distance on SO(3)."""
    between = np.swapaxes(estimate, -1, -2) @ truth
    # by sine and cosine, as the arccosine of the trace loses half its digits near zero; SciPy's Rotation.magnitude is
    # the same to 4e-14 degrees, not to the bit
    axis = between[..., [2, 0, 1], [1, 2, 0]] - between[..., [1, 2, 0], [2, 0, 1]]
    trace = np.trace(between, axis1=-2, axis2=-1)
    return np.degrees(np.arctan2(np.linalg.norm(axis, axis=-1), trace - 1.0))


def _mean(apart: FloatArray) -> FloatArray:
    """Return the mean over the last axis of what is not NaN; NaN where nothing is."""
    known = np.isfinite(apart)
    n = known.sum(axis=-1)
    total = np.where(known, apart, 0.0).sum(axis=-1)
    return np.where(n > 0, total / np.maximum(n, 1), np.nan)
