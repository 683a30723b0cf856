"""The annealed particle filter (Deutscher & Reid, Articulated Body Motion Capture by Stochastic Search, IJCV 2005)."""

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import replace

import numpy as np

from workbench.arrays import FloatArray
from workbench.datasets.frame import Frame
from workbench.errors import InputError
from workbench.inference.particle_filter import Advanced, Particles, Stopwatch, filtered, weigh
from workbench.inference.resampling import systematic
from workbench.inference.step import Step
from workbench.inference.target import Target
from workbench.likelihoods.likelihood import Likelihood
from workbench.priors.jitter import with_density
from workbench.priors.state import Prior, StateSpace

NO_POSTERIOR = (
    "annealed: the particles were gathered about the best pose they found; their spread is no posterior, bands and "
    "coverage say nothing about uncertainty, and there is no evidence"
)


class Annealed:
    """A search for the best pose in layers, each with a sharper likelihood and smaller noise. It is an optimiser.

    In layer l of L the particles are weighted by likelihood^(l / L)^power and resampled; in the next one they scatter
    with the deviation of the prior's noise, column by column, times shrink^l. Layer 1 is drawn by the prior; the last
    one is weighted by the likelihood itself and not resampled.

    The scatter is not corrected for, so that nothing but the first layer keeps to the prior: the weighted particles
    stand for no posterior. The first step says so, and every step's diagnostic is_posterior is 0; its log_evidence
    stays 0. Tempered SMC is the same idea made exact.

    Deviations. Deutscher & Reid choose the exponents by the survival rate and scatter by the particles' covariance;
    here both are schedules that are given. What scatters beyond the prior's limits stays where it was.

    n_particles: N, of every layer. layers: L. Raises InputError for a prior without a density, numbers out of range.
    """

    def __init__(
        self,
        prior: Prior,
        likelihood: Likelihood,
        *,
        n_particles: int = 1000,
        layers: int = 5,
        power: float = 1.5,
        shrink: float = 0.5,
    ) -> None:
        if n_particles < 1 or layers < 1 or not (0.0 < power < np.inf and 0.0 < shrink <= 1.0):
            raise InputError(
                "inference: expected n_particles and layers of at least 1, power above 0 and shrink above 0 up to 1, "
                f"found {n_particles}, {layers}, {power} and {shrink}"
            )
        with_density(prior)
        self.prior, self.likelihood = prior, likelihood
        self.space: StateSpace = prior.space
        self.n_particles, self.layers, self.power, self.shrink = n_particles, layers, power, shrink

    def run(
        self, frames: Iterable[Frame], start: FloatArray, rng_streams: Mapping[str, np.random.Generator]
    ) -> Iterator[Step]:
        """One step per frame; the first frame gives the start distribution around the pose `start` (P,), unweighted.

        rng_streams: generators named "start", "resampling" and "prior".
        """
        first = {"is_posterior": 0.0, "distinct": float(self.n_particles)}
        steps = filtered(self.prior, self.likelihood, self.n_particles, self.advance, frames, start, rng_streams, first)
        for count, step in enumerate(steps):
            yield step if count else replace(step, warnings=(NO_POSTERIOR, *step.warnings))

    def advance(
        self,
        parents: Particles,
        previous: Frame,
        frame: Frame,
        rng_streams: Mapping[str, np.random.Generator],
        clock: Stopwatch,
    ) -> Advanced:
        """From the weighted particles of the previous frame through all layers to those of this one."""
        target = Target(self.prior, self.likelihood, parents, previous, frame, clock)
        even = np.full(self.n_particles, -np.log(self.n_particles))
        chosen = systematic(np.exp(parents.log_weights), rng_streams["resampling"])
        pool = target.predicted(chosen, rng_streams["prior"])
        innovations, _, noisy = target.innovations(pool)
        for layer in range(1, self.layers):
            log_weights, _, said = weigh(frame, even, (layer / self.layers) ** self.power * pool.log_prob)
            target.warnings += said
            pool = pool.picked(systematic(np.exp(log_weights), rng_streams["resampling"]))
            clock.lap("resampling")
            noise = rng_streams["prior"].standard_normal(innovations.shape)
            scattered = target.nudged(pool, noisy, self.shrink**layer * innovations.std(axis=0) * noise)
            pool = pool.merged(scattered, np.isfinite(scattered.log_prior))
        log_weights, _, said = weigh(frame, even, pool.log_prob)
        target.warnings += said
        return pool.advanced(log_weights, 0.0, target, is_posterior=0.0)
