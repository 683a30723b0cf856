"""The peak of a Gaussian prior times a likelihood that is only known by its values, and the Gaussian about it."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from workbench.utils.arrays import FloatArray

LogLikelihood = Callable[[FloatArray], FloatArray]
"""Log likelihoods (N,) of poses (N, P); −∞ where it is undefined."""

LENGTHS = np.array([1.5, 1.0, 0.7, 0.5, 0.35, 0.25, 0.12, 0.06, 0.0])
"""Parts of a Newton step that are tried."""
NARROWEST, WIDEST = 0.02, 0.15
"""Distances between which a likelihood is looked at to either side of a pose, m or rad: nearer, pixels show; farther,
another limb may lie there."""
_FARTHEST = 3.0
"""Deviations of the prior that one step may go."""


@dataclass(frozen=True, eq=False)
class Peak:
    """pose: (P,) of highest posterior. covariance: (P, P) of the Gaussian about it. log_evidence: Laplace's
    approximation. evaluations: of the likelihood."""

    pose: FloatArray
    covariance: FloatArray
    log_evidence: float
    evaluations: int


def find_peak(
    log_likelihood: LogLikelihood, mean: FloatArray, covariance: FloatArray, limits: FloatArray, *,
    guesses: Sequence[FloatArray], steps: int, flatten: float,
) -> Peak:  # fmt: skip
    """Climb the posterior of a prior N(mean (P,), covariance (P, P)) within limits (P, 2) by Newton steps.

    It starts from the mean and adds, of each set of changes (G, P) in turn, the best or none: an arm that lies beside
    the image's arm sees no slope towards it. Derivatives are differences along the principal axes of the prior, over
    its deviation there, between NARROWEST and WIDEST; curvature that is not downwards counts as none; all but the last
    two steps take it to be diagonal. Of each step those LENGTHS are tried. flatten: power of the likelihood that
    narrows the covariance: cues err together, from pixel to pixel and from frame to frame.
    """
    values, axes = np.linalg.eigh(covariance)
    sigma = np.sqrt(np.maximum(values, 1e-12))
    widths = np.clip(sigma, NARROWEST, WIDEST)
    count = 0

    def posterior(poses: FloatArray) -> tuple[FloatArray, FloatArray]:
        nonlocal count
        count += len(poses)
        inside = np.clip(poses, *limits.T)
        seen = log_likelihood(inside)
        z = (inside - mean) @ axes / sigma
        return inside, seen - 0.5 * (z**2).sum(axis=1)

    x, curvature = mean, np.zeros((len(mean), len(mean)))
    for changes in guesses:
        tried, heights = posterior(x + np.concatenate([np.zeros((1, len(x))), changes]))
        x = tried[int(np.argmax(heights))]
    for step_number in range(steps):
        pairs = step_number >= steps - 2
        gradient, curvature, cost = differences(log_likelihood, x, axes * widths, limits, pairs)
        count += cost
        gradient, curvature = gradient / widths, curvature / np.outer(widths, widths)
        uphill = gradient - ((x - mean) @ axes) / sigma**2
        step = np.linalg.solve(curvature + np.diag(1.0 / sigma**2), uphill)
        step *= min(1.0, _FARTHEST / max(float(np.abs(step / sigma).max()), 1e-12))
        tried, heights = posterior(x + LENGTHS[:, None] * (axes @ step))
        x = tried[int(np.argmax(heights))]
    precision = np.diag(1.0 / sigma**2)
    narrowed = axes @ np.linalg.inv(precision + flatten * curvature) @ axes.T
    _, (height,) = posterior(x[None])
    _, volume = np.linalg.slogdet(np.eye(len(x)) + sigma[:, None] * curvature * sigma)
    return Peak(x, 0.5 * (narrowed + narrowed.T), float(height - 0.5 * volume), count)


def differences(
    log_likelihood: LogLikelihood, x: FloatArray, ways: FloatArray, limits: FloatArray, pairs: bool
) -> tuple[FloatArray, FloatArray, int]:
    """Approximate gradient (D,) and downward curvature (D, D), not negative, of the likelihood at x (P,) along ways (P,
    D), in their units, by central and, off the diagonal, forward differences, with `pairs` alone; and tell how many
    values that took."""
    d = ways.shape[1]
    first, second = np.triu_indices(d, 1) if pairs else (np.zeros(0, dtype=np.int64),) * 2
    unit = np.eye(d)
    places = np.concatenate([np.zeros((1, d)), unit, -unit, unit[first] + unit[second]])
    height = log_likelihood(np.clip(x + places @ ways.T, *limits.T))
    height = np.where(np.isfinite(height), height, np.min(height, initial=0.0, where=np.isfinite(height)))
    here, above, below, both = height[0], height[1 : d + 1], height[d + 1 : 2 * d + 1], height[2 * d + 1 :]
    curvature = np.diag(2.0 * here - above - below)
    curvature[first, second] = curvature[second, first] = above[first] + above[second] - here - both
    values, vectors = np.linalg.eigh(curvature)
    return 0.5 * (above - below), (vectors * np.maximum(values, 0.0)) @ vectors.T, len(places)
