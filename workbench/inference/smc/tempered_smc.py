"""Moves from the prior's prediction to a frame's posterior in stages: tempered SMC (Neal 2001; Del Moral, Doucet &
Jasra 2006; temperatures as in Jasra, Stephens, Doucet & Tsagaris 2011) and the annealed particle filter (Deutscher &
Reid, Articulated Body Motion Capture by Stochastic Search, IJCV 2005)."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from workbench.core.checks import INSIDE_UNIT, at_least, check
from workbench.inference.smc.move import DensityMove, Streams
from workbench.inference.smc.target import Candidates, MoveResult, Target
from workbench.inference.smc.weights import systematic, uniform_log_weights
from workbench.utils.arrays import BoolArray, FloatArray

TARGET_ACCEPTANCE_RATE = 0.25
"""Approximately optimal for a random walk in many dimensions (Roberts, Gelman & Gilks 1997)."""
MAX_TEMPERATURES = 100
BISECTIONS = 50


@dataclass(frozen=True)
class TemperedSMC(DensityMove):
    """Raise the likelihood's power φ from 0 to 1 in steps, and return a valid posterior.

    Each step of φ lowers the effective sample size to at most ess_threshold · N; after each step the particles are
    resampled and moved by `n_mcmc_steps` Metropolis steps that leave p(s_t | s_t−1) p(frame_t | s_t, s_t−1)^φ
    invariant: alternately samples from the prior mixed with the state (`_mix_with_prior`), whose length does not depend
    on the number of columns, and random walks with the particles' covariance (`_random_walk`), for sharp likelihoods.
    The posterior and the evidence are consistent as N grows; since temperatures and scales depend on the particles, the
    evidence is not strictly unbiased (Beskos, Jasra, Kantas & Thiery 2016). The final weights are equal.

    Diagnostics: n_temperatures; acceptance_rate, of the Metropolis steps; unique_particles, number of particles of the
    previous frame with offspring. Raises InputError for a prior without a density, a single particle, numbers out of
    range.
    """

    ess_threshold: float = 0.5
    n_mcmc_steps: int = 2

    min_particles: ClassVar[int] = 2
    first_diagnostics: ClassVar[Mapping[str, float]] = {"n_temperatures": 0.0, "acceptance_rate": 1.0}

    def __post_init__(self) -> None:
        check("inference", self, ess_threshold=INSIDE_UNIT, n_mcmc_steps=at_least(1))

    def __call__(self, target: Target, rng_streams: Streams) -> MoveResult:
        """Temper from the equally weighted particles of the previous frame to those of this one."""
        uniform, resampling, rng = uniform_log_weights(target.n), rng_streams["resampling"], rng_streams["prior"]
        candidates = target.predict(np.arange(target.n), rng)
        if not np.isfinite(candidates.log_prob).any():
            target.reweight(uniform, candidates.log_prob)
            return target.finalize(candidates, uniform, 0.0, n_temperatures=0.0, acceptance_rate=1.0)
        log_gain, phi, rates, n_temperatures = 0.0, 0.0, list[float](), 0
        noisy = target.noisy_columns(candidates)
        innovations, _ = target.innovations(candidates, noisy)
        sigma, scale, mixing = np.sqrt((innovations**2).mean(axis=0)), 1.0, 1.0
        while phi < 1.0:
            n_temperatures += 1
            next_phi = self._next_temperature(target, candidates.log_prob, phi, n_temperatures)
            log_weights, gain = target.reweight(uniform, (next_phi - phi) * candidates.log_prob)
            log_gain, phi = log_gain + gain, next_phi
            root = _walk_root(target, candidates, noisy, np.exp(log_weights))
            candidates = candidates.select(systematic(np.exp(log_weights), resampling))
            target.clock.lap("resampling")
            for k in range(self.n_mcmc_steps):
                if k % 2 == 0:
                    candidates, rate = _mix_with_prior(target, candidates, phi, sigma, mixing, noisy, rng)
                    mixing = min(1.0, mixing * float(np.exp(rate - TARGET_ACCEPTANCE_RATE)))
                else:
                    candidates, rate = _random_walk(target, candidates, phi, scale * root, noisy, rng)
                    scale *= float(np.exp(rate - TARGET_ACCEPTANCE_RATE))
                rates.append(rate)
        completed = target.sample_dependent(candidates, rng)
        diagnostics = {"n_temperatures": float(n_temperatures), "acceptance_rate": float(np.mean(rates))}
        return target.finalize(completed, uniform, log_gain, **diagnostics)

    def _next_temperature(self, target: Target, log_prob: FloatArray, phi: float, count: int) -> float:
        """Return the temperature after φ, the count-th; 1 if there are too many."""
        if count < MAX_TEMPERATURES:
            return next_temperature(log_prob, phi, self.ess_threshold)
        target.warnings.append(
            f"frame {target.frame.index}: {count} temperatures do not reach the posterior; the rest is one step"
        )
        return 1.0


def next_temperature(log_prob: FloatArray, phi: float, ess_threshold: float) -> float:
    """Return the φ' in (φ, 1] at which equal weights (N,) times likelihood^(φ' − φ) have the required effective size.

    This is ess_threshold times the number of particles of finite likelihood; 1 if it is larger there.
    """
    possible = log_prob[np.isfinite(log_prob)]

    def enough(candidate: float) -> bool:
        weights = np.exp((candidate - phi) * (possible - possible.max()))
        return float(weights.sum() ** 2 / (weights**2).sum()) >= ess_threshold * len(possible)

    if enough(1.0):
        return 1.0
    low, high = phi, 1.0
    for _ in range(BISECTIONS):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if enough(middle) else (low, middle)
    return high


def _walk_root(target: Target, candidates: Candidates, noisy: BoolArray, weights: FloatArray) -> FloatArray:
    """Return a matrix R (D', D') with R Rᵀ = 2.38² / D' times the covariance of the states given their parents.

    States are weighted; D' are the columns noisy (D,) (Roberts, Gelman & Gilks 1997). The covariance is that of the
    residuals of a linear regression of the innovations on the parents' means; otherwise the walk would step as far as
    the parents differ.
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
    """Return the candidates (N) after one Metropolis step at temperature φ by N(0, R Rᵀ), and the acceptance rate.

    root: R (D', D'), in the columns noisy (D,).
    """
    walk = rng.standard_normal((len(candidates.state), len(root))) @ root.T
    return _accept(candidates, target.shift(candidates, noisy, walk), phi, 0.0, rng)


def _mix_with_prior(
    target: Target, candidates: Candidates, phi: float, sigma: FloatArray, mixing: float, noisy: BoolArray,
    rng: np.random.Generator,
) -> tuple[Candidates, float]:  # fmt: skip
    """Return the candidates (N) after one preconditioned Crank–Nicolson step at temperature φ, and the acceptance rate.

    The step (Cotter, Roberts, Stuart & White 2013) changes the innovations: δ' = √(1 − m²) δ + m N(0, σ²), with σ (D',)
    and the mixing m. It leaves N(0, σ²) invariant, so that only the likelihood decides, and the prior where it differs.
    """
    innovations, _ = target.innovations(candidates, noisy)
    retained = np.sqrt(1.0 - mixing**2)
    mixed = retained * innovations + mixing * sigma * rng.standard_normal(innovations.shape)
    proposed = target.shift(candidates, noisy, mixed - innovations)
    correction = 0.5 * (((mixed / sigma) ** 2).sum(axis=1) - ((innovations / sigma) ** 2).sum(axis=1))
    return _accept(candidates, proposed, phi, correction, rng)


def _accept(
    candidates: Candidates, proposed: Candidates, phi: float, correction: FloatArray | float, rng: np.random.Generator
) -> tuple[Candidates, float]:
    """Accept proposals by the Metropolis–Hastings rule; correction: (N,), log ratio of the proposal densities."""
    log_ratio = proposed.log_prior - candidates.log_prior + phi * (proposed.log_prob - candidates.log_prob) + correction
    accepted = np.log1p(-rng.random(len(log_ratio))) < log_ratio
    return candidates.merge(proposed, accepted), float(accepted.mean())


_SCHEDULE_EXPONENT, _NOISE_DECAY = 1.5, 0.5
NO_POSTERIOR = (
    "annealed: the particles concentrate about the best pose found; their spread is not a posterior, credible "
    "intervals and coverage do not measure uncertainty, and there is no evidence"
)


@dataclass(frozen=True)
class Annealed(DensityMove):
    """Search for the best pose in layers, each with a sharper likelihood and smaller noise: an optimiser.

    In layer l of L the particles are weighted by likelihood^(l / L)^_SCHEDULE_EXPONENT and resampled; in the next one
    they scatter with the standard deviation of the prior's noise, column by column, times _NOISE_DECAY^l. The last
    layer is weighted by the likelihood itself. The scatter is not corrected for, so that the particles do not represent
    a posterior: the first step warns, every step's diagnostic is_posterior is 0 and its log_evidence NaN.

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
        """Move the weighted particles of the previous frame through all layers."""
        uniform = uniform_log_weights(target.n)
        resampling, rng = rng_streams["resampling"], rng_streams["prior"]
        candidates = target.predict(systematic(np.exp(target.parents.log_weights), resampling), rng)
        noisy = target.noisy_columns(candidates)
        innovations, _ = target.innovations(candidates, noisy)
        for layer in range(1, self.layers):
            log_weights, _ = target.reweight(uniform, (layer / self.layers) ** _SCHEDULE_EXPONENT * candidates.log_prob)
            candidates = candidates.select(systematic(np.exp(log_weights), resampling))
            target.clock.lap("resampling")
            noise = rng.standard_normal(innovations.shape)
            scattered = target.shift(candidates, noisy, _NOISE_DECAY**layer * innovations.std(axis=0) * noise)
            candidates = candidates.merge(scattered, np.isfinite(scattered.log_prior))
        log_weights, _ = target.reweight(uniform, candidates.log_prob)
        return target.finalize(target.sample_dependent(candidates, rng), log_weights, np.nan, is_posterior=0.0)
