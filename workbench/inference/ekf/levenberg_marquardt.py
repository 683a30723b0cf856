"""The mode of a heavy-tailed prior times a differentiable likelihood, and the Gaussian at it (Laplace)."""

from dataclasses import dataclass

import numpy as np

from workbench.core.likelihood import Derivatives, DifferentiableLikelihood
from workbench.utils.arrays import FloatArray, IntArray

MAX_STEPS = 5
"""At each level of smoothing."""
FINAL_TOLERANCE, TOLERANCE = 0.05, 0.5
"""Gain of a step below which the search ends at the last level of smoothing, and at an earlier one, nats."""
_MIN_DAMPING, _MAX_DAMPING = 0.1, 30.0
OUTLIER_SCALE = 3.0
"""Factor of the standard deviations of an outlier motion of a limb."""


@dataclass(frozen=True, eq=False)
class LaplaceApproximation:
    """The posterior's mode and the Gaussian at it.

    pose: (P,). covariance: (P, P). log_evidence: Laplace's approximation. evaluations: of the likelihood. slope: of the
    likelihood at the mode, at the last level of smoothing.
    """

    pose: FloatArray
    covariance: FloatArray
    log_evidence: float
    evaluations: int
    slope: Derivatives


@dataclass(frozen=True, eq=False)
class HeavyTailedPrior:
    """A Gaussian about a mean (P,) with heavier tails for each limb, as outlier motions are of whole limbs.

    A limb's parameters, given those before them, are (1 − ε) N(0, I) + ε N(0, OUTLIER_SCALE² I) in units of the
    Gaussian's standard deviations. whitening: (P, P), lower triangular, from a difference to these units. limbs: (P,),
    limb of each parameter. outlier_motion_probability: ε.
    """

    mean: FloatArray
    whitening: FloatArray
    limbs: IntArray
    outlier_motion_probability: float

    def log_density(self, pose: FloatArray) -> float:
        """Return the log density relative to the mean."""
        at_mean = np.logaddexp(*self._component_log_densities(np.zeros(int(self.limbs.max()) + 1)))
        return float((np.logaddexp(*self._component_log_densities(self._squared_deviations(pose))) - at_mean).sum())

    def precision(self, pose: FloatArray) -> FloatArray:
        """Return the precision (P, P) of the Gaussian about the mean with the same gradient at a pose."""
        nominal, outlier = self._component_log_densities(self._squared_deviations(pose))
        responsibility = np.exp(nominal - np.logaddexp(nominal, outlier))
        weights = responsibility + (1.0 - responsibility) / OUTLIER_SCALE**2
        return np.asarray((self.whitening.T * weights[self.limbs]) @ self.whitening)

    def _squared_deviations(self, pose: FloatArray) -> FloatArray:
        squares = (self.whitening @ (pose - self.mean)) ** 2
        return np.asarray(np.bincount(self.limbs, squares), dtype=np.float64)

    def _component_log_densities(self, squares: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return each limb's log densities of nominal and outlier motion, at sums of its squared deviations."""
        sizes = np.bincount(self.limbs)
        nominal = np.log1p(-self.outlier_motion_probability) - 0.5 * squares
        outlier = np.log(self.outlier_motion_probability) - sizes * np.log(OUTLIER_SCALE)
        return nominal, outlier - 0.5 * squares / OUTLIER_SCALE**2


def heavy_tailed_prior(
    mean: FloatArray, covariance: FloatArray, limbs: IntArray, outlier_motion_probability: float
) -> HeavyTailedPrior:
    """Return the heavy-tailed prior about a Gaussian."""
    root = np.linalg.cholesky(covariance + 1e-10 * np.eye(len(mean)))
    return HeavyTailedPrior(mean, np.linalg.inv(root), limbs, outlier_motion_probability)


def find_mode(
    frame_likelihood: DifferentiableLikelihood, mean: FloatArray, covariance: FloatArray, limits: FloatArray, *,
    start: FloatArray, limbs: IntArray, outlier_motion_probability: float, curvature_weight: float,
) -> LaplaceApproximation:  # fmt: skip
    """Return the mode found by damped Gauss–Newton steps (Levenberg 1944, Marquardt 1963), coarse to fine.

    Where a limb is far from its prediction, the covariance is larger according to how improbable that was.

    Parameters
    ----------
    frame_likelihood : of the frame.
    mean, covariance : (P,), (P, P), predicted.
    limits : (P, 2).
    start : (P,), initial pose of the search.
    limbs : (P,), limb of each parameter.
    outlier_motion_probability : see `HeavyTailedPrior`.
    curvature_weight : weight of the likelihood's curvature in the covariance; below 1, as the errors of cues are
        correlated between pixels and frames.
    """
    prior, pose, n_evaluations = heavy_tailed_prior(mean, covariance, limbs, outlier_motion_probability), start, 0
    for level in range(frame_likelihood.n_levels):
        pose, slope, n = _maximise(frame_likelihood, level, prior, pose, limits)
        n_evaluations += n
    return laplace_approximation(prior, pose, slope, curvature_weight, n_evaluations)


def laplace_approximation(
    prior: HeavyTailedPrior, pose: FloatArray, slope: Derivatives, curvature_weight: float, n_evaluations: int
) -> LaplaceApproximation:
    """Return the Gaussian at a pose (P,) with this slope of the likelihood, see `find_mode`."""
    precision = prior.precision(pose)
    covariance = np.linalg.inv(precision + curvature_weight * slope.curvature)
    _, log_volume = np.linalg.slogdet(np.eye(len(pose)) + slope.curvature @ np.linalg.inv(precision))
    log_evidence = slope.log_prob + prior.log_density(pose) - 0.5 * log_volume
    return LaplaceApproximation(pose, 0.5 * (covariance + covariance.T), float(log_evidence), n_evaluations, slope)


def _maximise(
    frame_likelihood: DifferentiableLikelihood, level: int, prior: HeavyTailedPrior, pose: FloatArray,
    limits: FloatArray,
) -> tuple[FloatArray, Derivatives, int]:  # fmt: skip
    """Maximise the posterior at one level; return the pose, the slope there, and the number of evaluations."""
    slope, damping = frame_likelihood.derivatives(pose, level), 0.0
    tolerance = FINAL_TOLERANCE if level == frame_likelihood.n_levels - 1 else TOLERANCE
    objective = slope.log_prob + prior.log_density(pose)
    for n_steps in range(1, MAX_STEPS + 1):
        precision = prior.precision(pose)
        curvature = slope.curvature + precision
        uphill = slope.gradient - precision @ (pose - prior.mean)
        step = np.linalg.solve(curvature + damping * np.diag(np.diag(curvature)), uphill)
        candidate = np.clip(pose + step, *limits.T)
        candidate_slope = frame_likelihood.derivatives(candidate, level)
        reached = candidate_slope.log_prob + prior.log_density(candidate)
        if reached > objective:
            converged = reached - objective < tolerance
            pose, slope, objective, damping = candidate, candidate_slope, reached, damping / 4.0
            if converged:
                return pose, slope, n_steps + 1
        else:
            damping = max(4.0 * damping, _MIN_DAMPING)
            if damping > _MAX_DAMPING:
                return pose, slope, n_steps + 1
    return pose, slope, MAX_STEPS + 1
