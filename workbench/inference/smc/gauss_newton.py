"""Draws about the peak of a frame's posterior, which Newton steps find first (Doucet, Godsill & Andrieu, On Sequential
Monte Carlo Sampling Methods for Bayesian Filtering, Statistics and Computing 10, 2000, II.D)."""

from dataclasses import dataclass
from typing import ClassVar

import numpy as np
import scipy

from workbench.core.checks import INSIDE_UNIT, UNIT, at_least, check
from workbench.core.state_space import StateSpace
from workbench.inference.smc.move import DensityMove, Streams
from workbench.inference.smc.target import STILL, MoveResult, Target
from workbench.inference.smc.weights import even_log_weights, systematic
from workbench.priors.density import phase_columns, state_difference
from workbench.utils.arrays import BoolArray, FloatArray, IntArray

FARTHEST = 2.0
"""Deviations of the prediction that a Newton step may go in a column."""


@dataclass(frozen=True)
class GaussNewton(DensityMove):
    """Draw from the product of the prior and a quadratic approximation of the log likelihood near its mode.

    A share of the particles have parents a and states s_t from

        q(a, s_t) ∝ w_a N(s_t; μ_a, Σ) exp(gᵀ(s_t − x) − ½ (s_t − x)ᵀ H (s_t − x))^flatten,

    μ_a being the prior's mean and Σ its noise; the parents are chosen by its integral (fully adapted, Pitt & Shephard
    1999). The others come from the prior. Weights are w_a p(s_t | s_t−1^a) p(frame_t | s_t) over the density of this
    mixture, so that the posterior is exact and the evidence unbiased for any x, g and H.

    x is found by Newton steps on the log posterior from the prediction's mean. g and the diagonal of H are central
    differences over one deviation of the prediction, the rest of H forward ones, of which all but the last step use
    none; negative eigenvalues are set to zero. A step costs 2 d + 1 evaluations for the d columns that a pose depends
    on, the last d (d − 1) / 2 more. The quadratic is that of one parent: where the likelihood depends on the previous
    pose, weights vary more. Robust image likelihoods are flatter at their mode than a quadratic; flatten < 1 allows for
    that.

    share: of the particles drawn about the mode. steps: of Newton. Raises InputError for a prior without a density, a
    single particle, and numbers out of range.
    """

    share: float = 0.8
    flatten: float = 1.0
    steps: int = 2

    least_particles: ClassVar[int] = 2

    def __post_init__(self) -> None:
        check("inference", self, share=INSIDE_UNIT, flatten=UNIT, steps=at_least(1))

    def __call__(self, target: Target, rng_streams: Streams) -> MoveResult:
        """Climb, draw from the mixture, weigh."""
        parents, n, rng = target.parents, target.n, rng_streams["prior"]
        prediction = predict(target, rng)
        quadratic = _newton_ascent(target, prediction, self.steps)
        guide = _Guide(prediction, quadratic, parents.log_weights, self.flatten)
        n_guided = round(self.share * n)
        counts = (guide.log_parents, n_guided), (parents.log_weights, n - n_guided)
        chosen = np.concatenate([systematic(np.exp(log_w), rng_streams["resampling"], k) for log_w, k in counts])
        target.clock.lap("resampling")
        state = target.prior.sample_transition(parents.state[chosen], target.dt_s, rng)
        state[:n_guided] = guide.draw(state[:n_guided], chosen[:n_guided], rng)
        drawn = target.evaluate(state, chosen)
        log_plain = parents.log_weights[chosen] + drawn.log_prior
        log_guided = np.log(n_guided / n) + guide.log_density(state, chosen)
        log_drawn = np.logaddexp(log_guided, np.log1p(-n_guided / n) + log_plain)
        log_weights, log_gain = target.weigh(even_log_weights(n), drawn.log_prob, log_plain - log_drawn)
        return target.settle(target.sample_dependent(drawn, rng), log_weights, log_gain)


@dataclass(frozen=True, eq=False)
class _PredictedStates:
    """What the prior predicts of a frame, of N parents and the D' columns that have noise.

    space: of the D columns. means: (N, D), where the parents lead without noise. middle: (D,), their weighted mean.
    noisy: (D',) indices of columns. sigma: (D',) deviations of the noise. covariance: (D', D'), of the prediction.
    """

    space: StateSpace
    means: FloatArray
    middle: FloatArray
    noisy: IntArray
    sigma: FloatArray
    covariance: FloatArray

    def move(self, states: FloatArray, changes: FloatArray) -> FloatArray:
        """Return states (M, D) after changes (M, D') of the columns that have noise."""
        states = states.copy()
        states[:, self.noisy] += changes
        states[:, phase_columns(self.space)] %= 1.0
        return states

    def difference(self, middle: FloatArray, states: FloatArray) -> FloatArray:
        """Return how far states (M, D) are from one (D,) in the columns that have noise, (M, D')."""
        return state_difference(self.space, middle, states)[:, self.noisy]


def predict(target: Target, rng: np.random.Generator) -> _PredictedStates:
    """Predict from the target's parents; deviations of the noise are those of one draw for each parent."""
    space, parents = target.prior.space, target.parents
    means = target.density.mean(parents.state, target.dt_s)
    noise = state_difference(space, means, target.prior.sample_transition(parents.state, target.dt_s, rng))
    noisy = np.flatnonzero(target.free() & (np.abs(noise).max(axis=0) > STILL))
    weights, heaviest = np.exp(parents.log_weights), means[np.argmax(parents.log_weights)]
    middle = heaviest + weights @ state_difference(space, heaviest, means)  # phases have no mean but beside one of them
    sigma = np.sqrt((noise[:, noisy] ** 2).mean(axis=0))
    off = state_difference(space, middle, means)[:, noisy]
    return _PredictedStates(space, means, middle, noisy, sigma, (weights * off.T) @ off + np.diag(sigma**2))


@dataclass(frozen=True, eq=False)
class _PosteriorModel:
    """log p(frame | s) ≈ … + gᵀ(s − x) − ½ (s − x)ᵀ H (s − x): x (D,), and of the columns that have noise gradient
    (D',) and curvature H (D', D'), which is not negative."""

    x: FloatArray
    gradient: FloatArray
    curvature: FloatArray


def _newton_ascent(target: Target, prediction: _PredictedStates, steps: int) -> _PosteriorModel:
    """Take so many Newton steps from the prediction's middle, all but the last with a diagonal H."""
    x, precision = prediction.middle, np.linalg.inv(prediction.covariance)
    for _ in range(steps - 1):
        quadratic = _fit_quadratic(target, prediction, x, pairs=False)
        uphill = quadratic.gradient - precision @ prediction.difference(prediction.middle, x[None])[0]
        step = np.linalg.solve(precision + quadratic.curvature, uphill)
        longest = np.abs(step / np.sqrt(np.diag(prediction.covariance))).max()
        x = prediction.move(x[None], step[None] * min(1.0, FARTHEST / max(longest, STILL)))[0]
    return _fit_quadratic(target, prediction, x, pairs=True)


def _fit_quadratic(target: Target, prediction: _PredictedStates, x: FloatArray, pairs: bool) -> _PosteriorModel:
    """Approximate the log likelihood at x (D,), by differences over one deviation of the prediction. What is impossible
    counts as the least of what is not. pairs: all of H, not just its diagonal."""
    widths = np.sqrt(np.diag(prediction.covariance))
    ahead = prediction.move(np.repeat(x[None], len(widths), axis=0), np.diag(widths))
    seen: BoolArray = np.abs(target.prior.pose(ahead) - target.prior.pose(x[None])).max(axis=1) > STILL
    d = int(seen.sum())
    first, second = np.triu_indices(d, 1) if pairs else (np.zeros(0, dtype=np.int64),) * 2
    unit = np.eye(d)
    places = np.zeros((1 + 2 * d + len(first), len(widths)))
    places[:, seen] = np.concatenate([np.zeros((1, d)), unit, -unit, unit[first] + unit[second]])
    states = prediction.move(np.repeat(x[None], len(places), axis=0), widths * places)
    parent = int(np.argmax(target.parents.log_weights))
    height = target.evaluate(states, np.full(len(states), parent)).log_prob
    possible = np.isfinite(height)
    height = np.where(possible, height, height[possible].min() if possible.any() else 0.0)
    here, above, below, both = height[0], height[1 : d + 1], height[d + 1 : 2 * d + 1], height[2 * d + 1 :]
    curvature = np.diag(2.0 * here - above - below)
    curvature[first, second] = curvature[second, first] = above[first] + above[second] - here - both
    values, vectors = np.linalg.eigh(curvature)
    gradient, whole = np.zeros(len(widths)), np.zeros((len(widths), len(widths)))
    gradient[seen] = 0.5 * (above - below) / widths[seen]
    whole[np.ix_(seen, seen)] = (vectors * np.maximum(values, 0.0)) @ vectors.T / np.outer(widths[seen], widths[seen])
    return _PosteriorModel(x, gradient, whole)


class _Guide:
    """The density q of `GaussNewton`: a Gaussian for each of the N parents, of one covariance, and their log weights.
    flatten: power that the quadratic is taken to. log_parents: (N,)."""

    def __init__(
        self, prediction: _PredictedStates, quadratic: _PosteriorModel, log_weights: FloatArray, flatten: float
    ) -> None:
        self._prediction, self._x = prediction, quadratic.x
        precision = 1.0 / prediction.sigma**2
        covariance = np.linalg.inv(np.diag(precision) + flatten * quadratic.curvature)
        self._root = np.linalg.cholesky(covariance)
        ahead = prediction.difference(quadratic.x, prediction.means)
        pull = ahead * precision + flatten * quadratic.gradient
        self._means = pull @ covariance  # (N, D'), beside x
        log_parents = log_weights + 0.5 * (pull * self._means).sum(axis=1) - 0.5 * (ahead**2 * precision).sum(axis=1)
        self.log_parents: FloatArray = log_parents - scipy.special.logsumexp(log_parents)

    def draw(self, states: FloatArray, parents: IntArray, rng: np.random.Generator) -> FloatArray:
        """Draw the columns that have noise anew, in states (M, D) of these parents (M,)."""
        noise = rng.standard_normal((len(parents), len(self._root)))
        drawn = states.copy()
        drawn[:, self._prediction.noisy] = self._x[self._prediction.noisy]
        return self._prediction.move(drawn, self._means[parents] + noise @ self._root.T)

    def log_density(self, states: FloatArray, parents: IntArray) -> FloatArray:
        """Return log q, (M,), of parents (M,) together with states (M, D)."""
        off = self._prediction.difference(self._x, states) - self._means[parents]
        white = scipy.linalg.solve_triangular(self._root, off.T, lower=True)
        constant = float(np.log(np.sqrt(2.0 * np.pi) * np.diag(self._root)).sum())
        return self.log_parents[parents] - 0.5 * (white**2).sum(axis=0) - constant
