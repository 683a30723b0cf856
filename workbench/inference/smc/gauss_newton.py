"""Sampling about the mode of a frame's posterior, found by Newton steps (Doucet, Godsill & Andrieu, On Sequential
Monte Carlo Sampling Methods for Bayesian Filtering, Statistics and Computing 10, 2000, II.D)."""

from dataclasses import dataclass
from typing import ClassVar

import numpy as np
import scipy

from workbench.core.checks import INSIDE_UNIT, UNIT, at_least, check
from workbench.core.state_space import StateSpace
from workbench.inference.smc.move import DensityMove, Streams
from workbench.inference.smc.target import ZERO_NOISE, MoveResult, Target
from workbench.inference.smc.weights import systematic, uniform_log_weights
from workbench.priors.density import phase_columns, state_difference
from workbench.utils.arrays import BoolArray, FloatArray, IntArray

MAX_STEP = 2.0
"""Largest change of a column in a Newton step, in standard deviations of the prediction."""


@dataclass(frozen=True)
class GaussNewton(DensityMove):
    """Sample from the product of the prior and a quadratic approximation of the log likelihood near its mode.

    A fraction of the particles have parents a and states s_t from

        q(a, s_t) ∝ w_a N(s_t; μ_a, Σ) exp(gᵀ(s_t − x) − ½ (s_t − x)ᵀ H (s_t − x))^κ,

    with the prior's mean μ_a and noise Σ, and κ = curvature_weight; the parents are chosen by its integral (fully
    adapted, Pitt & Shephard 1999). The others come from the prior. Weights are w_a p(s_t | s_t−1^a) p(frame_t | s_t)
    over the density of this mixture, so that the posterior is exact and the evidence unbiased for any x, g and H.

    x is found by Newton steps on the log posterior from the prediction's mean. g and the diagonal of H are central
    differences over one standard deviation of the prediction, the rest of H forward ones, which only the last step
    uses; negative eigenvalues are set to zero. A step costs 2 d + 1 evaluations for the d columns that a pose depends
    on, the last d (d − 1) / 2 more. The quadratic is that of one parent: if the likelihood depends on the previous
    pose, weights vary more. Robust image likelihoods are flatter at their mode than a quadratic; κ < 1 allows for that.

    proposal_fraction: of the particles sampled about the mode. n_newton_steps: number of steps. Raises InputError for a
    prior without a density, a single particle, and numbers out of range.
    """

    proposal_fraction: float = 0.8
    curvature_weight: float = 1.0
    n_newton_steps: int = 2

    min_particles: ClassVar[int] = 2

    def __post_init__(self) -> None:
        check("inference", self, proposal_fraction=INSIDE_UNIT, curvature_weight=UNIT, n_newton_steps=at_least(1))

    def __call__(self, target: Target, rng_streams: Streams) -> MoveResult:
        """Find the mode, sample from the mixture, weight."""
        parents, n, rng = target.parents, target.n, rng_streams["prior"]
        prediction = predict_states(target, rng)
        quadratic = _newton_ascent(target, prediction, self.n_newton_steps)
        proposal = _ModeProposal(prediction, quadratic, parents.log_weights, self.curvature_weight)
        n_proposed = round(self.proposal_fraction * n)
        counts = (proposal.log_parents, n_proposed), (parents.log_weights, n - n_proposed)
        ancestors = np.concatenate([systematic(np.exp(log_w), rng_streams["resampling"], k) for log_w, k in counts])
        target.clock.lap("resampling")
        state = target.prior.sample_transition(parents.state[ancestors], target.dt_s, rng)
        state[:n_proposed] = proposal.sample(state[:n_proposed], ancestors[:n_proposed], rng)
        candidates = target.evaluate(state, ancestors)
        log_prior = parents.log_weights[ancestors] + candidates.log_prior
        log_proposal = np.log(n_proposed / n) + proposal.log_density(state, ancestors)
        log_mixture = np.logaddexp(log_proposal, np.log1p(-n_proposed / n) + log_prior)
        weighted = target.reweight(uniform_log_weights(n), candidates.log_prob, log_prior - log_mixture)
        return target.finalize(target.sample_dependent(candidates, rng), *weighted)


@dataclass(frozen=True, eq=False)
class _PredictedStates:
    """The prior's prediction of a frame from N parents, of which D' columns have noise.

    space: of the D columns. means: (N, D), of each parent. mean: (D,), their weighted mean. noisy: (D',), indices of
    columns. sigma: (D',), standard deviations of the noise. covariance: (D', D'), of the prediction.
    """

    space: StateSpace
    means: FloatArray
    mean: FloatArray
    noisy: IntArray
    sigma: FloatArray
    covariance: FloatArray

    def shift(self, states: FloatArray, changes: FloatArray) -> FloatArray:
        """Return states (M, D) after changes (M, D') of the columns that have noise."""
        states = states.copy()
        states[:, self.noisy] += changes
        states[:, phase_columns(self.space)] %= 1.0
        return states

    def difference(self, origin: FloatArray, states: FloatArray) -> FloatArray:
        """Return the differences (M, D') of states (M, D) from one (D,), in the columns that have noise."""
        return state_difference(self.space, origin, states)[:, self.noisy]


def predict_states(target: Target, rng: np.random.Generator) -> _PredictedStates:
    """Return the prediction from the target's parents; the noise is estimated from one sample for each parent."""
    space, parents = target.prior.space, target.parents
    means = target.density.mean(parents.state, target.dt_s)
    noise = state_difference(space, means, target.prior.sample_transition(parents.state, target.dt_s, rng))
    noisy = np.flatnonzero(target.free_columns() & (np.abs(noise).max(axis=0) > ZERO_NOISE))
    weights, heaviest = np.exp(parents.log_weights), means[np.argmax(parents.log_weights)]
    mean = heaviest + weights @ state_difference(
        space, heaviest, means
    )  # phases have a mean only relative to one of them
    sigma = np.sqrt((noise[:, noisy] ** 2).mean(axis=0))
    deviations = state_difference(space, mean, means)[:, noisy]
    covariance = (weights * deviations.T) @ deviations + np.diag(sigma**2)
    return _PredictedStates(space, means, mean, noisy, sigma, covariance)


@dataclass(frozen=True, eq=False)
class _QuadraticModel:
    """log p(frame | s) ≈ … + gᵀ(s − x) − ½ (s − x)ᵀ H (s − x).

    x: (D,). gradient: (D',) and curvature: H (D', D'), positive semidefinite, of the columns that have noise.
    """

    x: FloatArray
    gradient: FloatArray
    curvature: FloatArray


def _newton_ascent(target: Target, prediction: _PredictedStates, n_steps: int) -> _QuadraticModel:
    """Return the quadratic after Newton steps from the prediction's mean, all but the last with a diagonal H."""
    x, precision = prediction.mean, np.linalg.inv(prediction.covariance)
    for _ in range(n_steps - 1):
        quadratic = _fit_quadratic(target, prediction, x, pairs=False)
        uphill = quadratic.gradient - precision @ prediction.difference(prediction.mean, x[None])[0]
        step = np.linalg.solve(precision + quadratic.curvature, uphill)
        longest = np.abs(step / np.sqrt(np.diag(prediction.covariance))).max()
        x = prediction.shift(x[None], step[None] * min(1.0, MAX_STEP / max(longest, ZERO_NOISE)))[0]
    return _fit_quadratic(target, prediction, x, pairs=True)


def _fit_quadratic(target: Target, prediction: _PredictedStates, x: FloatArray, pairs: bool) -> _QuadraticModel:
    """Approximate the log likelihood at x (D,) by differences over one standard deviation of the prediction.

    Impossible states count as the least likely possible one. pairs: all of H, not only its diagonal.
    """
    widths = np.sqrt(np.diag(prediction.covariance))
    ahead = prediction.shift(np.repeat(x[None], len(widths), axis=0), np.diag(widths))
    observed: BoolArray = np.abs(target.prior.pose(ahead) - target.prior.pose(x[None])).max(axis=1) > ZERO_NOISE
    d = int(observed.sum())
    first, second = np.triu_indices(d, 1) if pairs else (np.zeros(0, dtype=np.int64),) * 2
    unit = np.eye(d)
    changes = np.zeros((1 + 2 * d + len(first), len(widths)))
    changes[:, observed] = np.concatenate([np.zeros((1, d)), unit, -unit, unit[first] + unit[second]])
    states = prediction.shift(np.repeat(x[None], len(changes), axis=0), widths * changes)
    parent = int(np.argmax(target.parents.log_weights))
    log_prob = target.evaluate(states, np.full(len(states), parent)).log_prob
    possible = np.isfinite(log_prob)
    log_prob = np.where(possible, log_prob, log_prob[possible].min() if possible.any() else 0.0)
    centre, above, below, both = log_prob[0], log_prob[1 : d + 1], log_prob[d + 1 : 2 * d + 1], log_prob[2 * d + 1 :]
    curvature = np.diag(2.0 * centre - above - below)
    curvature[first, second] = curvature[second, first] = above[first] + above[second] - centre - both
    values, vectors = np.linalg.eigh(curvature)
    gradient, full = np.zeros(len(widths)), np.zeros((len(widths), len(widths)))
    gradient[observed] = 0.5 * (above - below) / widths[observed]
    scaled = (vectors * np.maximum(values, 0.0)) @ vectors.T / np.outer(widths[observed], widths[observed])
    full[np.ix_(observed, observed)] = scaled
    return _QuadraticModel(x, gradient, full)


class _ModeProposal:
    """The density q of `GaussNewton`: a Gaussian for each of the N parents, of one covariance, and their log weights.

    curvature_weight: power of the quadratic. log_parents: (N,), normalised log weights of the parents.
    """

    def __init__(
        self, prediction: _PredictedStates, quadratic: _QuadraticModel, log_weights: FloatArray, curvature_weight: float
    ) -> None:
        self._prediction, self._x = prediction, quadratic.x
        precision = 1.0 / prediction.sigma**2
        covariance = np.linalg.inv(np.diag(precision) + curvature_weight * quadratic.curvature)
        self._root = np.linalg.cholesky(covariance)
        ahead = prediction.difference(quadratic.x, prediction.means)
        information = ahead * precision + curvature_weight * quadratic.gradient
        self._means = information @ covariance  # (N, D'), relative to x
        log_integrals = 0.5 * (information * self._means).sum(axis=1)
        log_parents = log_weights + log_integrals - 0.5 * (ahead**2 * precision).sum(axis=1)
        self.log_parents: FloatArray = log_parents - scipy.special.logsumexp(log_parents)

    def sample(self, states: FloatArray, parents: IntArray, rng: np.random.Generator) -> FloatArray:
        """Return states (M, D) of parents (M,) with sampled values in the columns that have noise."""
        noise = rng.standard_normal((len(parents), len(self._root)))
        sampled = states.copy()
        sampled[:, self._prediction.noisy] = self._x[self._prediction.noisy]
        return self._prediction.shift(sampled, self._means[parents] + noise @ self._root.T)

    def log_density(self, states: FloatArray, parents: IntArray) -> FloatArray:
        """Return log q (M,) of parents (M,) together with states (M, D)."""
        deviations = self._prediction.difference(self._x, states) - self._means[parents]
        white = scipy.linalg.solve_triangular(self._root, deviations.T, lower=True)
        constant = float(np.log(np.sqrt(2.0 * np.pi) * np.diag(self._root)).sum())
        return self.log_parents[parents] - 0.5 * (white**2).sum(axis=0) - constant
