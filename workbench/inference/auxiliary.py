"""The auxiliary particle filter: look at the frame before choosing who goes on (Pitt & Shephard 1999)."""

from collections.abc import Iterable, Iterator, Mapping

import numpy as np
from scipy.special import logsumexp

from workbench.arrays import FloatArray
from workbench.datasets.frame import Frame
from workbench.errors import InputError
from workbench.inference.particle_filter import Advanced, Particles, Stopwatch, filtered, weigh
from workbench.inference.resampling import systematic
from workbench.inference.step import Step
from workbench.inference.target import Target, promise
from workbench.likelihoods.likelihood import Likelihood
from workbench.priors.jitter import with_density
from workbench.priors.state import Prior, StateSpace


class Auxiliary:
    """A particle filter whose parents are chosen by how likely the frame is where each of them leads without noise.

        λ_i ∝ w_i p(frame_t | μ_i)^flatten,  a ~ λ,  s_t ~ p(s_t | s_t−1^a),
        w ∝ p(frame_t | s_t) / p(frame_t | μ_a)^flatten

    μ_i is the prior's mean. Exact for every flatten: 0 is the plain filter; 1 (Pitt & Shephard) trusts the look ahead
    fully, which makes weights heavy-tailed where the likelihood is sharper than the prior's noise. The likelihood is
    evaluated twice for each of the n_particles. Raises InputError for a prior without a density, numbers out of range.
    """

    def __init__(self, prior: Prior, likelihood: Likelihood, *, n_particles: int = 2500, flatten: float = 0.5) -> None:
        if n_particles < 1 or not 0.0 <= flatten <= 1.0:
            raise InputError(
                "inference: expected n_particles of at least 1 and flatten between 0 and 1, "
                f"found {n_particles} and {flatten}"
            )
        with_density(prior)
        self.prior, self.likelihood = prior, likelihood
        self.space: StateSpace = prior.space
        self.n_particles, self.flatten = n_particles, flatten

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
        """Look ahead, choose the parents, propagate, weigh."""
        target = Target(self.prior, self.likelihood, parents, previous, frame, clock)
        ahead = target.at(target.density.mean(parents.state, target.dt_s), np.arange(self.n_particles))
        bonus = promise(ahead.log_prob, self.flatten)
        first = parents.log_weights + bonus
        log_sum = float(logsumexp(first))
        chosen = systematic(np.exp(first - log_sum), rng_streams["resampling"])
        clock.lap("resampling")
        pool = target.predicted(chosen, rng_streams["prior"])
        even = np.full(self.n_particles, -np.log(self.n_particles))
        log_weights, gained, said = weigh(frame, even, pool.log_prob, log_sum - bonus[chosen])
        target.warnings += said
        return pool.advanced(log_weights, gained, target)
