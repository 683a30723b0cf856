"""Tempered sequential Monte Carlo: from the prior's prediction to a frame's posterior by degrees (Neal 2001;
Del Moral, Doucet & Jasra 2006; temperatures as in Jasra, Stephens, Doucet & Tsagaris 2011)."""

from collections.abc import Iterable, Iterator, Mapping

import numpy as np

from workbench.arrays import BoolArray, FloatArray
from workbench.datasets.frame import Frame
from workbench.errors import InputError
from workbench.inference.particle_filter import (
    Advanced,
    Particles,
    Stopwatch,
    filtered,
    weigh,
)
from workbench.inference.resampling import systematic
from workbench.inference.step import Step
from workbench.inference.target import Pool, Target
from workbench.likelihoods.likelihood import Likelihood
from workbench.priors.jitter import with_density
from workbench.priors.state import Prior, StateSpace

WANTED_ACCEPTANCE = 0.25
"""Of a random walk in many dimensions, about the best (Roberts, Gelman & Gilks 1997)."""
MOST_TEMPERATURES = 100
BISECTIONS = 50


class TemperedSMC:
    """A particle filter that takes each frame's likelihood in by degrees, and leaves a valid posterior.

    Between the prior's prediction and the posterior lie the densities p(s_t | s_t−1) p(frame_t | s_t, s_t−1)^φ. φ rises
    from 0 to 1 by steps so small that the effective sample size falls to ess_threshold · N at most; after each, the
    particles are resampled and then moved by `moves` Metropolis steps that leave the density of this φ as it is. So
    particles that share a parent come apart again, and a sharp likelihood needs no lucky particle. Steps are in turn
    draws from the prior mixed with the state (`mixed`), whose length does not depend on how many columns there are, and
    random walks with the particles' covariance (`walked`), which are better where the likelihood is sharp.

    The posterior and the evidence are consistent as N grows. The temperatures, the random walk's covariance and the
    scales of the steps come from the particles themselves, so that the evidence is not strictly unbiased (Beskos,
    Jasra, Kantas & Thiery 2016). Particles end with equal weights.

    n_particles: N. Raises InputError for a prior without a density and numbers out of range.
    """

    def __init__(
        self,
        prior: Prior,
        likelihood: Likelihood,
        *,
        n_particles: int = 1000,
        ess_threshold: float = 0.5,
        moves: int = 2,
    ) -> None:
        if n_particles < 2 or moves < 1 or not 0.0 < ess_threshold < 1.0:
            raise InputError(
                "inference: expected n_particles of at least 2, moves of at least 1 and ess_threshold between 0 and 1, "
                f"found {n_particles}, {moves} and {ess_threshold}"
            )
        with_density(prior)
        self.prior, self.likelihood = prior, likelihood
        self.space: StateSpace = prior.space
        self.n_particles, self.ess_threshold, self.moves = n_particles, ess_threshold, moves

    def run(
        self, frames: Iterable[Frame], start: FloatArray, rng_streams: Mapping[str, np.random.Generator]
    ) -> Iterator[Step]:
        """One step per frame; the first frame gives the start distribution around the pose `start` (P,), unweighted.

        rng_streams: generators named "start", "resampling" and "prior". Diagnostics: temperatures, how many there were;
        acceptance, of the moves; distinct, how many particles of the frame before have offspring.
        """
        first = {"temperatures": 0.0, "acceptance": 1.0, "distinct": float(self.n_particles)}
        return filtered(self.prior, self.likelihood, self.n_particles, self.advance, frames, start, rng_streams, first)

    def advance(
        self,
        parents: Particles,
        previous: Frame,
        frame: Frame,
        rng_streams: Mapping[str, np.random.Generator],
        clock: Stopwatch,
    ) -> Advanced:
        """From the equally weighted particles of the previous frame to those of this one."""
        target = Target(self.prior, self.likelihood, parents, previous, frame, clock)
        even = np.full(self.n_particles, -np.log(self.n_particles))
        pool = target.predicted(np.arange(self.n_particles), rng_streams["prior"])
        if not np.isfinite(pool.log_prob).any():
            target.warnings += weigh(frame, even, pool.log_prob)[2]
            return pool.advanced(even, 0.0, target, temperatures=0.0, acceptance=1.0)
        log_gain, phi, rates, count = 0.0, 0.0, list[float](), 0
        innovations, _, noisy = target.innovations(pool)
        sigma, scale, share = np.sqrt((innovations**2).mean(axis=0)), 1.0, 1.0
        while phi < 1.0:
            count += 1
            if count == MOST_TEMPERATURES:
                target.warnings.append(f"frame {frame.index}: {count} temperatures did not do; took the rest at once")
            following = next_temperature(pool.log_prob, phi, self.ess_threshold) if count < MOST_TEMPERATURES else 1.0
            log_weights, gained, _ = weigh(frame, even, (following - phi) * pool.log_prob)
            log_gain, phi = log_gain + gained, following
            root = walk_root(target, pool, noisy, np.exp(log_weights))
            pool = pool.picked(systematic(np.exp(log_weights), rng_streams["resampling"]))
            clock.lap("resampling")
            for move in range(self.moves):
                if move % 2 == 0:
                    pool, rate = mixed(target, pool, phi, sigma, share, noisy, rng_streams["prior"])
                    share = min(1.0, share * float(np.exp(rate - WANTED_ACCEPTANCE)))
                else:
                    pool, rate = walked(target, pool, phi, scale * root, noisy, rng_streams["prior"])
                    scale *= float(np.exp(rate - WANTED_ACCEPTANCE))
                rates.append(rate)
        return pool.advanced(even, log_gain, target, temperatures=float(count), acceptance=float(np.mean(rates)))


def next_temperature(log_prob: FloatArray, phi: float, ess_threshold: float) -> float:
    """The φ' in (φ, 1] at which equally weighted particles (N,), weighted by likelihood^(φ' − φ), have an effective
    sample size of ess_threshold times the number of those that are possible at all; 1 where that has more."""
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


def walk_root(target: Target, pool: Pool, noisy: BoolArray, weights: FloatArray) -> FloatArray:
    """A matrix R (D', D'), R Rᵀ being 2.38² / D' times the covariance of weighted states given their parents, over the
    columns that have noise, noisy (D,) (Roberts, Gelman & Gilks 1997).

    Given their parents: of what a linear regression of the innovations on the parents' means leaves. Without it, the
    walk would step as far as the parents are apart.
    """
    innovations, means = target.innovations_of(pool, noisy)
    root_weights = np.sqrt(weights)[:, None]
    means, innovations = (root_weights * (x - (weights[:, None] * x).sum(axis=0)) for x in (means, innovations))
    left = innovations - means @ np.linalg.lstsq(means, innovations, rcond=None)[0]
    values, vectors = np.linalg.eigh(left.T @ left)
    root: FloatArray = vectors * (2.38 * np.sqrt(np.maximum(values, 0.0) / max(1, len(values))))
    return root


def walked(
    target: Target, pool: Pool, phi: float, root: FloatArray, noisy: BoolArray, rng: np.random.Generator
) -> tuple[Pool, float]:
    """The pool (N) after one Metropolis step at temperature φ, and the share of proposals accepted.

    Proposals walk from the states by N(0, R Rᵀ), R being the root (D', D'), in the columns that are noisy (D,).
    """
    walk = rng.standard_normal((len(pool.state), len(root))) @ root.T
    return _accepted(pool, target.nudged(pool, noisy, walk), phi, 0.0, rng)


def mixed(
    target: Target, pool: Pool, phi: float, sigma: FloatArray, share: float, noisy: BoolArray, rng: np.random.Generator
) -> tuple[Pool, float]:
    """The same by a preconditioned Crank–Nicolson step (Cotter, Roberts, Stuart & White 2013) on what the states are
    away from where their parents lead, δ' = √(1 − share²) δ + share N(0, σ²), σ (D',).

    It leaves N(0, σ²) as it is, so that only the likelihood, and where the prior is not quite that, decides.
    """
    innovations, _ = target.innovations_of(pool, noisy)
    kept = np.sqrt(1.0 - share**2)
    drawn = kept * innovations + share * sigma * rng.standard_normal(innovations.shape)
    proposed = target.nudged(pool, noisy, drawn - innovations)
    correction = 0.5 * (((drawn / sigma) ** 2).sum(axis=1) - ((innovations / sigma) ** 2).sum(axis=1))
    return _accepted(pool, proposed, phi, correction, rng)


def _accepted(
    pool: Pool, proposed: Pool, phi: float, correction: FloatArray | float, rng: np.random.Generator
) -> tuple[Pool, float]:
    """correction: (N,), log of how much likelier the way back is to be proposed."""
    log_ratio = proposed.log_prior - pool.log_prior + phi * (proposed.log_prob - pool.log_prob) + correction
    accepted = np.log1p(-rng.random(len(log_ratio))) < log_ratio
    return pool.merged(proposed, accepted), float(accepted.mean())
