"""The annealed particle filter's move (Deutscher & Reid, Articulated Body Motion Capture by Stochastic Search, IJCV
2005)."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from workbench.core.checks import at_least, check
from workbench.inference.smc.move import DensityMove, Streams
from workbench.inference.smc.target import Moved, Target
from workbench.inference.smc.weights import even_log_weights, systematic

_POWER, _SHRINK = 1.5, 0.5  # of the schedules of weights and of scatter
NO_POSTERIOR = (
    "annealed: the particles were gathered about the best pose they found; their spread is no posterior, bands and "
    "coverage say nothing about uncertainty, and there is no evidence"
)


@dataclass(frozen=True)
class Annealed(DensityMove):
    """Search for the best pose in layers, each with a sharper likelihood and smaller noise: an optimiser.

    In layer l of L the particles are weighted by likelihood^(l / L)^_POWER and resampled; in the next one they scatter
    with the deviation of the prior's noise, column by column, times _SHRINK^l. Layer 1 is drawn by the prior; the last
    one is weighted by the likelihood itself and not resampled.

    The scatter is not corrected for, so that nothing but the first layer keeps to the prior: the weighted particles
    stand for no posterior. The first step says so, and every step's diagnostic is_posterior is 0; its log_evidence
    stays 0. Tempered SMC makes this idea exact.

    Deviations. Deutscher & Reid choose the exponents by the survival rate and scatter by the particles' covariance;
    here both are schedules that are given. What scatters beyond the prior's limits stays where it was.

    layers: L, of N particles each. Raises InputError for a prior without a density and numbers out of range.
    """

    layers: int = 5

    first_diagnostics: ClassVar[Mapping[str, float]] = {"is_posterior": 0.0}
    first_warnings: ClassVar[tuple[str, ...]] = (NO_POSTERIOR,)

    def __post_init__(self) -> None:
        check("inference", self, layers=at_least(1))

    def __call__(self, target: Target, rng_streams: Streams) -> Moved:
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
        return target.settle(target.complete(candidates, rng), log_weights, np.nan, is_posterior=0.0)
