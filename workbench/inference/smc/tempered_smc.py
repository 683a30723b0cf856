"""Moves by degrees from the prior's prediction to a frame's posterior: tempered SMC (Neal 2001; Del Moral, Doucet &
Jasra 2006; temperatures as in Jasra, Stephens, Doucet & Tsagaris 2011) and the annealed particle filter (Deutscher &
Reid, Articulated Body Motion Capture by Stochastic Search, IJCV 2005)."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from workbench.core.checks import INSIDE_UNIT, at_least, check
from workbench.inference.smc.move import DensityMove, Streams
from workbench.inference.smc.target import Candidates, MoveResult, Target
from workbench.inference.smc.weights import even_log_weights, systematic
from workbench.utils.arrays import BoolArray, FloatArray

WANTED_ACCEPTANCE = 0.25
"""Of a random walk in many dimensions, about the best (Roberts, Gelman & Gilks 1997)."""
MOST_TEMPERATURES = 100
BISECTIONS = 50


@dataclass(frozen=True)
class TemperedSMC(DensityMove):
    """Raise the likelihood's power φ from 0 to 1 by steps, and leave a valid posterior.

    φ rises so that the effective sample size falls to ess_threshold · N at most; after each step the particles are
    resampled and moved by `moves` Metropolis steps that leave p(s_t | s_t−1) p(frame_t | s_t, s_t−1)^φ invariant: in
    turn draws from the prior mixed with the state (`_mix_with_prior`), whose length does not depend on the number of
    columns, and random walks with the particles' covariance (`_random_walk`), for sharp likelihoods. The posterior and
    the evidence are consistent as N grows; since temperatures and scales come from the particles, the evidence is not
    strictly unbiased (Beskos, Jasra, Kantas & Thiery 2016). Particles end with equal weights.

    Diagnostics: n_temperatures; acceptance_rate, of the moves; unique_particles, how many particles of the frame
    before have offspring. Raises InputError for a prior without a density, a single particle, numbers out of range.
    """

    ess_threshold: float = 0.5
    moves: int = 2

    least_particles: ClassVar[int] = 2
    first_diagnostics: ClassVar[Mapping[str, float]] = {"n_temperatures": 0.0, "acceptance_rate": 1.0}

    def __post_init__(self) -> None:
        check("inference", self, ess_threshold=INSIDE_UNIT, moves=at_least(1))

    def __call__(self, target: Target, rng_streams: Streams) -> MoveResult:
        """Temper from the equally weighted particles of the previous frame to those of this one."""
        even, resampling, rng = even_log_weights(target.n), rng_streams["resampling"], rng_streams["prior"]
        candidates = target.predict(np.arange(target.n), rng)
        if not np.isfinite(candidates.log_prob).any():
            target.weigh(even, candidates.log_prob)
            return target.settle(candidates, even, 0.0, n_temperatures=0.0, acceptance_rate=1.0)
        log_gain, phi, rates, count = 0.0, 0.0, list[float](), 0
        noisy = target.noisy(candidates)
        innovations, _ = target.innovations(candidates, noisy)
        sigma, scale, share = np.sqrt((innovations**2).mean(axis=0)), 1.0, 1.0
        while phi < 1.0:
            count += 1
            following = self._following(target, candidates.log_prob, phi, count)
            log_weights, gained = target.weigh(even, (following - phi) * candidates.log_prob)
            log_gain, phi = log_gain + gained, following
            root = _walk_root(target, candidates, noisy, np.exp(log_weights))
            candidates = candidates.pick(systematic(np.exp(log_weights), resampling))
            target.clock.lap("resampling")
            for move in range(self.moves):
                if move % 2 == 0:
                    candidates, rate = _mix_with_prior(target, candidates, phi, sigma, share, noisy, rng)
                    share = min(1.0, share * float(np.exp(rate - WANTED_ACCEPTANCE)))
                else:
                    candidates, rate = _random_walk(target, candidates, phi, scale * root, noisy, rng)
                    scale *= float(np.exp(rate - WANTED_ACCEPTANCE))
                rates.append(rate)
        settled = target.sample_dependent(candidates, rng)
        return target.settle(
            settled, even, log_gain, n_temperatures=float(count), acceptance_rate=float(np.mean(rates))
        )

    def _following(self, target: Target, log_prob: FloatArray, phi: float, count: int) -> float:
        """Return the temperature after φ, the count-th; the last one where there are too many."""
        if count < MOST_TEMPERATURES:
            return next_temperature(log_prob, phi, self.ess_threshold)
        target.warnings.append(f"frame {target.frame.index}: {count} temperatures did not do; took the rest at once")
        return 1.0


def next_temperature(log_prob: FloatArray, phi: float, ess_threshold: float) -> float:
    """Find the φ' in (φ, 1] at which even particles (N,), weighted by likelihood^(φ' − φ), have an effective sample
    size of ess_threshold times the number of those that are possible at all; 1 where that has more."""
    possible = log_prob[np.isfinite(log_prob)]

    def enough(following: float) -> bool:
        weights = np.exp((following - phi) * (possible - possible.max()))
        return float(weights.sum() ** 2 / (weights**2).sum()) >= ess_threshold * len(possible)

    if enough(1.0):
        return 1.0
    low, high = phi, 1.0
    for _ in range(BISECTIONS):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if enough(middle) else (low, middle)
    return high


def _walk_root(target: Target, candidates: Candidates, noisy: BoolArray, weights: FloatArray) -> FloatArray:
    """Return a matrix R (D', D'), R Rᵀ being 2.38² / D' times the covariance of weighted states given their parents, in
    the columns noisy (D,) (Roberts, Gelman & Gilks 1997).

    The covariance is that of what a linear regression of the innovations on the parents' means leaves; otherwise the
    walk would step as far as the parents are apart.
    """
    innovations, means = target.innovations(candidates, noisy)
    root_weights = np.sqrt(weights)[:, None]
    means, innovations = (root_weights * (x - (weights[:, None] * x).sum(axis=0)) for x in (means, innovations))
    residuals = innovations - means @ np.linalg.lstsq(means, innovations, rcond=None)[0]
    values, vectors = np.linalg.eigh(residuals.T @ residuals)
    return vectors * (2.38 * np.sqrt(np.maximum(values, 0.0) / max(1, len(values))))


def _random_walk(
    target: Target, candidates: Candidates, phi: float, root: FloatArray, noisy: BoolArray, rng: np.random.Generator
) -> tuple[Candidates, float]:
    """Take one Metropolis step at temperature φ by N(0, R Rᵀ), R being the root (D', D'), in the columns noisy (D,).
    Returns the candidates (N) after it and the share of proposals accepted."""
    walk = rng.standard_normal((len(candidates.state), len(root))) @ root.T
    return _accept(candidates, target.shift(candidates, noisy, walk), phi, 0.0, rng)


def _mix_with_prior(
    target: Target, candidates: Candidates, phi: float, sigma: FloatArray, share: float, noisy: BoolArray,
    rng: np.random.Generator,
) -> tuple[Candidates, float]:  # fmt: skip
    """Take one preconditioned Crank–Nicolson step (Cotter, Roberts, Stuart & White 2013) at temperature φ on the
    innovations, δ' = √(1 − share²) δ + share N(0, σ²), σ (D',).

    It leaves N(0, σ²) as it is, so that only the likelihood decides, and the prior where it is not quite that. Returns
    the candidates (N) after it and the share of proposals accepted.
    """
    innovations, _ = target.innovations(candidates, noisy)
    kept = np.sqrt(1.0 - share**2)
    drawn = kept * innovations + share * sigma * rng.standard_normal(innovations.shape)
    proposed = target.shift(candidates, noisy, drawn - innovations)
    correction = 0.5 * (((drawn / sigma) ** 2).sum(axis=1) - ((innovations / sigma) ** 2).sum(axis=1))
    return _accept(candidates, proposed, phi, correction, rng)


def _accept(
    candidates: Candidates, proposed: Candidates, phi: float, correction: FloatArray | float, rng: np.random.Generator
) -> tuple[Candidates, float]:
    """Accept proposals by Metropolis' rule; correction: (N,), log of how much likelier the way back is proposed."""
    log_ratio = proposed.log_prior - candidates.log_prior + phi * (proposed.log_prob - candidates.log_prob) + correction
    accepted = np.log1p(-rng.random(len(log_ratio))) < log_ratio
    return candidates.merge(proposed, accepted), float(accepted.mean())


_POWER, _SHRINK = 1.5, 0.5  # of the schedules of weights and of scatter
NO_POSTERIOR = (
    "annealed: the particles were gathered about the best pose they found; their spread is no posterior, bands and "
    "coverage say nothing about uncertainty, and there is no evidence"
)


@dataclass(frozen=True)
class Annealed(DensityMove):
    """Search for the best pose in layers, each with a sharper likelihood and smaller noise: an optimiser.

    In layer l of L the particles are weighted by likelihood^(l / L)^_POWER and resampled; in the next one they scatter
    with the deviation of the prior's noise, column by column, times _SHRINK^l. The last layer is weighted by the
    likelihood itself. The scatter is not corrected for, so that the particles stand for no posterior: the first step
    warns, every step's diagnostic is_posterior is 0 and its log_evidence NaN.

    Deviations. Deutscher & Reid choose the exponents by the survival rate and scatter by the particles' covariance;
    here both are fixed schedules. Particles that scatter beyond the prior's limits stay in place.

    layers: L, of N particles each. Raises InputError for a prior without a density and numbers out of range.
    """

    layers: int = 5

    first_diagnostics: ClassVar[Mapping[str, float]] = {"is_posterior": 0.0}
    first_warnings: ClassVar[tuple[str, ...]] = (NO_POSTERIOR,)

    def __post_init__(self) -> None:
        check("inference", self, layers=at_least(1))

    def __call__(self, target: Target, rng_streams: Streams) -> MoveResult:
        """Take the weighted particles of the previous frame through all layers."""
        even = even_log_weights(target.n)
        resampling, rng = rng_streams["resampling"], rng_streams["prior"]
        candidates = target.predict(systematic(np.exp(target.parents.log_weights), resampling), rng)
        noisy = target.noisy(candidates)
        innovations, _ = target.innovations(candidates, noisy)
        for layer in range(1, self.layers):
            log_weights, _ = target.weigh(even, (layer / self.layers) ** _POWER * candidates.log_prob)
            candidates = candidates.pick(systematic(np.exp(log_weights), resampling))
            target.clock.lap("resampling")
            noise = rng.standard_normal(innovations.shape)
            scattered = target.shift(candidates, noisy, _SHRINK**layer * innovations.std(axis=0) * noise)
            candidates = candidates.merge(scattered, np.isfinite(scattered.log_prior))
        log_weights, _ = target.weigh(even, candidates.log_prob)
        return target.settle(target.sample_dependent(candidates, rng), log_weights, np.nan, is_posterior=0.0)
