"""The peak of a prior with heavy tails times a likelihood that knows its derivatives, and the Gaussian about it."""

from dataclasses import dataclass

import numpy as np

from workbench.core.likelihood import Derivatives, DifferentiableLikelihood
from workbench.utils.arrays import FloatArray, IntArray

STEPS = 5
"""At most, at every smoothing."""
ENOUGH, ENOUGH_YET = 0.05, 0.5
"""A step that gains less ends the climb at the last smoothing, and at one before it, nats."""
_LEAST_DAMPING, _MOST_DAMPING = 0.1, 30.0
FARTHER = 3.0
"""Factor of the deviations of a limb that moves suddenly."""


@dataclass(frozen=True, eq=False)
class Peak:
    """The posterior's mode and the Gaussian about it.

    pose: (P,). covariance: (P, P). log_evidence: Laplace's approximation. evaluations: of the likelihood. slope: of the
    likelihood there, at the last smoothing.
    """

    pose: FloatArray
    covariance: FloatArray
    log_evidence: float
    evaluations: int
    slope: Derivatives


@dataclass(frozen=True, eq=False)
class Tails:
    """A Gaussian about a mean (P,) with heavier tails, limb by limb: sudden moves are of whole limbs.

    A limb's numbers, given those before them, are (1 − ε) N(0, I) + ε N(0, FARTHER² I) in the Gaussian's own
    deviations. white: (P, P), lower triangular, from a difference to deviations. limbs: (P,), of each number. sudden:
    ε."""

    mean: FloatArray
    white: FloatArray
    limbs: IntArray
    sudden: float

    def height(self, pose: FloatArray) -> float:
        """Its log density, 0 at the mean."""
        at_mean = np.logaddexp(*self._parts(np.zeros(int(self.limbs.max()) + 1)))
        return float((np.logaddexp(*self._parts(self._squares(pose))) - at_mean).sum())

    def precision(self, pose: FloatArray) -> FloatArray:
        """The precision (P, P) of the Gaussian about the mean whose slope at a pose is the same."""
        usual, far = self._parts(self._squares(pose))
        foreseen = np.exp(usual - np.logaddexp(usual, far))
        weights = foreseen + (1.0 - foreseen) / FARTHER**2
        return np.asarray((self.white.T * weights[self.limbs]) @ self.white)

    def _squares(self, pose: FloatArray) -> FloatArray:
        return np.asarray(np.bincount(self.limbs, (self.white @ (pose - self.mean)) ** 2), dtype=np.float64)

    def _parts(self, squares: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Log densities of every limb as it is foreseen and as it is not, at sums of its squared deviations."""
        sizes = np.bincount(self.limbs)
        usual = np.log1p(-self.sudden) - 0.5 * squares
        return usual, np.log(self.sudden) - sizes * np.log(FARTHER) - 0.5 * squares / FARTHER**2


def tails(mean: FloatArray, covariance: FloatArray, limbs: IntArray, sudden: float) -> Tails:
    """Return the tails about a Gaussian."""
    root = np.linalg.cholesky(covariance + 1e-10 * np.eye(len(mean)))
    return Tails(mean, np.linalg.inv(root), limbs, sudden)


def climb(
    frame_likelihood: DifferentiableLikelihood, mean: FloatArray, covariance: FloatArray, limits: FloatArray, *,
    start: FloatArray, limbs: IntArray, sudden: float, flatten: float,
) -> Peak:  # fmt: skip
    """Climb from a pose `start` (P,) by damped Gauss–Newton steps (Levenberg 1944, Marquardt 1963), smoothing by
    smoothing.

    mean, covariance: (P,), (P, P), predicted. limits: (P, 2). limbs: (P,), which limb each number moves. sudden: see
    `Tails`. flatten: power of the likelihood that narrows the covariance: cues err together, from pixel to pixel and
    frame to frame. Where a limb is far from the prediction, the covariance is wider by as much as that was unlikely.
    """
    prior, pose, count = tails(mean, covariance, limbs, sudden), start, 0
    for level in range(frame_likelihood.n_levels):
        pose, slope, taken = _climb_at(frame_likelihood, level, prior, pose, limits)
        count += taken
    return peak_at(prior, pose, slope, flatten, count)


def peak_at(prior: Tails, pose: FloatArray, slope: Derivatives, flatten: float, count: int) -> Peak:
    """The Gaussian about a pose (P,) where the likelihood's slope is given, after `count` evaluations, see `climb`."""
    precision = prior.precision(pose)
    narrowed = np.linalg.inv(precision + flatten * slope.curvature)
    _, volume = np.linalg.slogdet(np.eye(len(pose)) + slope.curvature @ np.linalg.inv(precision))
    height = slope.log_prob + prior.height(pose) - 0.5 * volume
    return Peak(pose, 0.5 * (narrowed + narrowed.T), float(height), count, slope)


def _climb_at(
    frame_likelihood: DifferentiableLikelihood, level: int, prior: Tails, pose: FloatArray, limits: FloatArray
) -> tuple[FloatArray, Derivatives, int]:
    """Climb at one smoothing; return the pose, the slope there, and how often the likelihood was asked."""
    slope, damping = frame_likelihood.derivatives(pose, level), 0.0
    least = ENOUGH if level == frame_likelihood.n_levels - 1 else ENOUGH_YET
    height = slope.log_prob + prior.height(pose)
    for taken in range(1, STEPS + 1):
        precision = prior.precision(pose)
        curvature = slope.curvature + precision
        uphill = slope.gradient - precision @ (pose - prior.mean)
        step = np.linalg.solve(curvature + damping * np.diag(np.diag(curvature)), uphill)
        tried = np.clip(pose + step, *limits.T)
        at_tried = frame_likelihood.derivatives(tried, level)
        reached = at_tried.log_prob + prior.height(tried)
        if reached > height:
            enough = reached - height < least
            pose, slope, height, damping = tried, at_tried, reached, damping / 4.0
            if enough:
                return pose, slope, taken + 1
        else:
            damping = max(4.0 * damping, _LEAST_DAMPING)
            if damping > _MOST_DAMPING:
                return pose, slope, taken + 1
    return pose, slope, STEPS + 1
