"""A particle filter that looks for the peak of each frame's posterior first and draws about it (Doucet, Godsill &
Andrieu, On Sequential Monte Carlo Sampling Methods for Bayesian Filtering, Statistics and Computing 10, 2000, II.D)."""

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass

import numpy as np
from scipy.linalg import solve_triangular
from scipy.special import logsumexp

from workbench.arrays import BoolArray, FloatArray, IntArray
from workbench.datasets.frame import Frame
from workbench.errors import InputError
from workbench.inference.particle_filter import Advanced, Particles, Stopwatch, filtered, weigh
from workbench.inference.resampling import systematic_draws
from workbench.inference.step import Step
from workbench.inference.target import STILL, Target
from workbench.likelihoods.likelihood import Likelihood
from workbench.priors.density import apart, circular
from workbench.priors.jitter import with_density
from workbench.priors.state import Prior, StateSpace

FARTHEST = 2.0
"""Deviations of the prediction that a Newton step may go in a column."""


class GaussNewton:
    """Particles drawn from the product of the prior and a parabola that touches the log likelihood near its peak.

    A share of the particles have parents a and states s_t from

        q(a, s_t) ∝ w_a N(s_t; μ_a, Σ) exp(gᵀ(s_t − x) − ½ (s_t − x)ᵀ H (s_t − x))^flatten,

    μ_a being the prior's mean and Σ its noise: a Gaussian for each parent, and the parents chosen by what it integrates
    to (fully adapted, Pitt & Shephard 1999). The others come from the prior. Weights are w_a p(s_t | s_t−1^a)
    p(frame_t | s_t) over the density of this mixture, so that the posterior is exact and the evidence unbiased whatever
    x, g and H are; the prior's part bounds the weights.

    x is found by Newton steps on the log posterior from the prediction's mean. g and the diagonal of H are central
    differences over one deviation of the prediction, the rest of H forward ones; its negative eigenvalues are set to
    zero. All but the last step take H to be diagonal.
    Columns that no pose depends on, such as velocities, have no curvature and cost nothing; d others cost 2 d + 1
    evaluations in a step and d (d − 1) / 2 more in the last, beside one for each particle.

    The parabola is that of one parent. A likelihood that looks at the previous pose, as image motion does, differs from
    parent to parent: weights are right all the same, but vary more.

    It is worth most for a sharp likelihood of a few numbers, such as points or marks. Robust image likelihoods of many
    numbers are flatter than a parabola at their peak, and little is won; flatten then keeps it from being too sure.

    n_particles: N. share: of those drawn about the peak. steps: of Newton.
    Raises InputError for a prior without a density and numbers out of range.
    """

    def __init__(
        self,
        prior: Prior,
        likelihood: Likelihood,
        *,
        n_particles: int = 2000,
        share: float = 0.8,
        flatten: float = 1.0,
        steps: int = 2,
    ) -> None:
        if n_particles < 2 or steps < 1 or not (0.0 < share < 1.0 and 0.0 <= flatten <= 1.0):
            raise InputError(
                "inference: expected n_particles of at least 2, steps of at least 1, share and flatten "
                f"between 0 and 1, found {n_particles}, {steps}, {share} and {flatten}"
            )
        with_density(prior)
        self.prior, self.likelihood = prior, likelihood
        self.space: StateSpace = prior.space
        self.n_particles, self.share, self.flatten, self.steps = n_particles, share, flatten, steps

    def run(
        self, frames: Iterable[Frame], start: FloatArray, rng_streams: Mapping[str, np.random.Generator]
    ) -> Iterator[Step]:
        """One step per frame; the first frame gives the start distribution around the pose `start` (P,), unweighted.

        rng_streams: generators named "start", "resampling" and "prior".
        """
        first = {"distinct": float(self.n_particles)}
        return filtered(self.prior, self.likelihood, self.n_particles, self.advance, frames, start, rng_streams, first)

    def advance(
        self,
        parents: Particles,
        previous: Frame,
        frame: Frame,
        rng_streams: Mapping[str, np.random.Generator],
        clock: Stopwatch,
    ) -> Advanced:
        """Climb, draw from the mixture, weigh."""
        target = Target(self.prior, self.likelihood, parents, previous, frame, clock)
        prediction = predicted(target, rng_streams["prior"])
        parabola = climbed(target, prediction, self.steps)
        guide = Guide(prediction, parabola, parents.log_weights, self.flatten)
        n_guided = round(self.share * self.n_particles)
        chosen = np.concatenate(
            [
                systematic_draws(np.exp(guide.log_parents), n_guided, rng_streams["resampling"]),
                systematic_draws(np.exp(parents.log_weights), self.n_particles - n_guided, rng_streams["resampling"]),
            ]
        )
        clock.lap("resampling")
        state = self.prior.step(parents.state[chosen], target.dt_s, rng_streams["prior"])
        state[:n_guided] = guide.draw(state[:n_guided], chosen[:n_guided], rng_streams["prior"])
        pool = target.at(state, chosen)
        log_plain = parents.log_weights[chosen] + pool.log_prior
        log_drawn = np.logaddexp(
            np.log(n_guided / self.n_particles) + guide.log_density(state, chosen),
            np.log1p(-n_guided / self.n_particles) + log_plain,
        )
        even = np.full(self.n_particles, -np.log(self.n_particles))
        log_weights, gained, said = weigh(frame, even, pool.log_prob, log_plain - log_drawn)
        target.warnings += said
        return pool.advanced(log_weights, gained, target)


@dataclass(frozen=True, eq=False)
class Prediction:
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

    def moved(self, states: FloatArray, changes: FloatArray) -> FloatArray:
        """States (M, D) after changes (M, D') of the columns that have noise."""
        states = states.copy()
        states[:, self.noisy] += changes
        states[:, circular(self.space)] %= 1.0
        return states

    def beside(self, middle: FloatArray, states: FloatArray) -> FloatArray:
        """(M, D'): how far states (M, D) are from one (D,) in the columns that have noise."""
        return apart(self.space, middle, states)[:, self.noisy]


def predicted(target: Target, rng: np.random.Generator) -> Prediction:
    """The prediction from the target's parents; deviations of the noise are those of one draw for each parent."""
    space, parents = target.prior.space, target.parents
    means = target.density.mean(parents.state, target.dt_s)
    noise = apart(space, means, target.prior.step(parents.state, target.dt_s, rng))
    noisy = np.flatnonzero(np.abs(noise).max(axis=0) > STILL)
    weights, heaviest = np.exp(parents.log_weights), means[np.argmax(parents.log_weights)]
    middle = heaviest + weights @ apart(space, heaviest, means)  # phases have no mean but beside one of them
    sigma = np.sqrt((noise[:, noisy] ** 2).mean(axis=0))
    off = apart(space, middle, means)[:, noisy]
    return Prediction(space, means, middle, noisy, sigma, (weights * off.T) @ off + np.diag(sigma**2))


@dataclass(frozen=True, eq=False)
class Parabola:
    """log p(frame | s) ≈ … + gᵀ(s − x) − ½ (s − x)ᵀ H (s − x): x (D,), and of the columns that have noise gradient
    (D',) and curvature H (D', D'), which is not negative."""

    x: FloatArray
    gradient: FloatArray
    curvature: FloatArray


def climbed(target: Target, prediction: Prediction, steps: int) -> Parabola:
    """The parabola after so many Newton steps from the prediction's middle, all but the last with a diagonal H."""
    x, precision = prediction.middle, np.linalg.inv(prediction.covariance)
    for _ in range(steps - 1):
        parabola = touching(target, prediction, x, pairs=False)
        uphill = parabola.gradient - precision @ prediction.beside(prediction.middle, x[None])[0]
        step = np.linalg.solve(precision + parabola.curvature, uphill)
        longest = np.abs(step / np.sqrt(np.diag(prediction.covariance))).max()
        x = prediction.moved(x[None], step[None] * min(1.0, FARTHEST / max(longest, STILL)))[0]
    return touching(target, prediction, x, pairs=True)


def touching(target: Target, prediction: Prediction, x: FloatArray, pairs: bool) -> Parabola:
    """The parabola at x (D,), by differences over one deviation of the prediction; pairs: not just the diagonal of H.
    What is impossible counts as the least of what is not."""
    widths = np.sqrt(np.diag(prediction.covariance))
    ahead = prediction.moved(np.repeat(x[None], len(widths), axis=0), np.diag(widths))
    seen: BoolArray = np.abs(target.prior.pose(ahead) - target.prior.pose(x[None])).max(axis=1) > STILL
    d = int(seen.sum())
    first, second = np.triu_indices(d, 1) if pairs else (np.zeros(0, dtype=np.int64),) * 2
    unit = np.eye(d)
    places = np.zeros((1 + 2 * d + len(first), len(widths)))
    places[:, seen] = np.concatenate([np.zeros((1, d)), unit, -unit, unit[first] + unit[second]])
    states = prediction.moved(np.repeat(x[None], len(places), axis=0), widths * places)
    parent = int(np.argmax(target.parents.log_weights))
    height = target.at(states, np.full(len(states), parent)).log_prob
    possible = np.isfinite(height)
    height = np.where(possible, height, height[possible].min() if possible.any() else 0.0)
    here, above, below, both = height[0], height[1 : d + 1], height[d + 1 : 2 * d + 1], height[2 * d + 1 :]
    curvature = np.diag(2.0 * here - above - below)
    curvature[first, second] = curvature[second, first] = above[first] + above[second] - here - both
    values, vectors = np.linalg.eigh(curvature)
    gradient, whole = np.zeros(len(widths)), np.zeros((len(widths), len(widths)))
    gradient[seen] = 0.5 * (above - below) / widths[seen]
    whole[np.ix_(seen, seen)] = (vectors * np.maximum(values, 0.0)) @ vectors.T / np.outer(widths[seen], widths[seen])
    return Parabola(x, gradient, whole)


class Guide:
    """The density q of `GaussNewton`: a Gaussian for each of the N parents, of one covariance, and their log weights.

    flatten: power that the parabola is taken to. log_parents: (N,).
    """

    def __init__(self, prediction: Prediction, parabola: Parabola, log_weights: FloatArray, flatten: float) -> None:
        self._prediction, self._x = prediction, parabola.x
        precision = 1.0 / prediction.sigma**2
        covariance = np.linalg.inv(np.diag(precision) + flatten * parabola.curvature)
        self._root = np.linalg.cholesky(covariance)
        ahead = prediction.beside(parabola.x, prediction.means)
        pull = ahead * precision + flatten * parabola.gradient
        self._means = pull @ covariance  # (N, D'), beside x
        log_parents = log_weights + 0.5 * (pull * self._means).sum(axis=1) - 0.5 * (ahead**2 * precision).sum(axis=1)
        self.log_parents: FloatArray = log_parents - logsumexp(log_parents)

    def draw(self, states: FloatArray, parents: IntArray, rng: np.random.Generator) -> FloatArray:
        """States (M, D) of these parents (M,), with the columns that have noise drawn anew."""
        noise = rng.standard_normal((len(parents), len(self._root)))
        drawn = states.copy()
        drawn[:, self._prediction.noisy] = self._x[self._prediction.noisy]
        return self._prediction.moved(drawn, self._means[parents] + noise @ self._root.T)

    def log_density(self, states: FloatArray, parents: IntArray) -> FloatArray:
        """log q, (M,), of parents (M,) together with states (M, D)."""
        off = self._prediction.beside(self._x, states) - self._means[parents]
        white = solve_triangular(self._root, off.T, lower=True)
        constant = float(np.log(np.sqrt(2.0 * np.pi) * np.diag(self._root)).sum())
        density: FloatArray = self.log_parents[parents] - 0.5 * (white**2).sum(axis=0) - constant
        return density
