"""Refine a pose by all pixels of a frame.

Surface elements whose appearance was learned at slightly wrong poses agree with those poses however far the estimate
drifts. The image layers locate the person's outline and the occlusions instead.
"""

import numpy as np

from workbench.core.likelihood import DenseLikelihood, Derivatives
from workbench.inference.ekf.levenberg_marquardt import HeavyTailedPrior
from workbench.utils.arrays import BoolArray, FloatArray

MAX_STEPS = 4
STEP_LENGTHS = (1.0, 0.5, 0.25)
"""Fractions of a step that are tried; the first that increases the log posterior is taken."""
MIN_CURVATURE_RATIO = 3.0
"""Minimum curvature of the points along an axis, relative to the prior's, for the layers to be evaluated along it: in
unobservable directions, such as depth, their pixels contribute only noise."""
MIN_CHANGE, MAX_CHANGE = 0.025, 0.15
"""Bounds of the largest change of a pose parameter in a finite difference, m or rad."""
MIN_GAIN = 0.5
"""Minimum increase of the log posterior by a step, nats."""


def refine_pose(
    frame_likelihood: DenseLikelihood, prior: HeavyTailedPrior, pose: FloatArray, slope: Derivatives,
    limits: FloatArray, joints: BoolArray,
) -> tuple[FloatArray, Derivatives, int]:  # fmt: skip
    """Maximise log prior + log p(points) + log p(layers) from a pose near the mode of the first two terms.

    The layers' derivatives are finite differences along the axes that diagonalise both the prior's precision and the
    points' curvature, over one standard deviation of both together, and only along axes that the points observe
    (MIN_CURVATURE_RATIO). The layers' curvature is taken to be diagonal and non-negative along these axes.

    Parameters
    ----------
    frame_likelihood : of the frame.
    prior : of the pose.
    pose : (P,), initial.
    slope : of the points at the initial pose.
    limits : (P, 2).
    joints : (J,), all true.

    Returns
    -------
    The pose, the slope of the points at it, and the number of evaluations of the layers.
    """
    last, n_evaluations = frame_likelihood.n_levels - 1, 0
    for _ in range(MAX_STEPS):
        precision = prior.precision(pose)
        root = np.linalg.inv(np.linalg.cholesky(precision)).T
        ratios, rotation = np.linalg.eigh(root.T @ slope.curvature @ root)
        axes, observed = root @ rotation, ratios > MIN_CURVATURE_RATIO  # of prior deviation 1, of the points √(1/ratio)
        largest = np.abs(axes).max(axis=0)
        widths = np.clip(1.0 / np.sqrt(1.0 + np.maximum(ratios, 0.0)), MIN_CHANGE / largest, MAX_CHANGE / largest)
        gradient, curvature = np.zeros(len(pose)), np.zeros(len(pose))
        changes = (axes * widths)[:, observed]
        gradient[observed], curvature[observed] = _finite_differences(frame_likelihood, pose, changes, limits, joints)
        uphill = axes.T @ (slope.gradient - precision @ (pose - prior.mean)) + gradient / widths
        step = axes @ (uphill / (1.0 + ratios + curvature / widths**2))
        candidates = np.clip(pose + np.array(STEP_LENGTHS)[:, None] * step, *limits.T)
        layers = frame_likelihood.compare(np.concatenate([pose[None], candidates]), joints)
        n_evaluations += 2 * changes.shape[1] + 2 + len(STEP_LENGTHS)
        current = slope.log_prob + prior.log_density(pose) + layers[0]
        for candidate, log_prob in zip(candidates, layers[1:], strict=True):
            candidate_slope = frame_likelihood.derivatives(candidate, last)
            if candidate_slope.log_prob + prior.log_density(candidate) + log_prob > current + MIN_GAIN:
                pose, slope = candidate, candidate_slope
                break
        else:
            break
    return pose, slope, n_evaluations


def _finite_differences(
    frame_likelihood: DenseLikelihood, pose: FloatArray, changes: FloatArray, limits: FloatArray, joints: BoolArray
) -> tuple[FloatArray, FloatArray]:
    """Return gradient (D,) and non-negative downward curvature (D,) of the layers at a pose (P,), per change (P, D)."""
    d = changes.shape[1]
    poses = pose + np.concatenate([np.zeros((1, len(pose))), changes.T, -changes.T])
    log_probs = frame_likelihood.compare(np.clip(poses, *limits.T), joints)
    centre, above, below = log_probs[0], log_probs[1 : d + 1], log_probs[d + 1 :]
    return 0.5 * (above - below), np.maximum(2.0 * centre - above - below, 0.0)
