"""The bootstrap filter's move: resample, draw from the prior, weigh (Gordon, Salmond & Smith 1993)."""

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from workbench.core.capabilities import Traits, offering
from workbench.core.checks import UNIT, check, one_of
from workbench.core.prior import Prior
from workbench.inference.smc.move import First, Streams
from workbench.inference.smc.target import Moved, Particles, Target
from workbench.inference.smc.weights import RESAMPLING, even_log_weights


@dataclass(frozen=True)
class Bootstrap:
    """Draw from the posterior at t−1, propagate by the prior, weight by the likelihood (paper A, section 4.1).

    Where the prior draws from a proposal of its own (`core.prior.Proposing`), its correction enters the weights.

    resampling: systematic, multinomial or residual. ess_threshold: resample when the effective sample size falls to
    this fraction of N or below; 1 resamples before every frame, as the paper does. Raises InputError for others.
    """

    traits: ClassVar[Traits] = offering()

    resampling: str = "systematic"
    ess_threshold: float = 1.0

    proposes: ClassVar[bool] = True
    gathers: ClassVar[bool] = True

    def __post_init__(self) -> None:
        check("inference", self, resampling=one_of(*RESAMPLING), ess_threshold=UNIT)

    def check(self, prior: Prior, n_particles: int) -> None:
        """Accept every prior."""

    def first(self, n_particles: int) -> First:
        """Say nothing of the first step."""
        return {}, ()

    def __call__(self, target: Target, rng_streams: Streams) -> Moved:
        """Resample, propagate, weigh."""
        log_weights, ancestors = target.parents.log_weights, np.arange(target.n)
        if target.parents.ess <= self.ess_threshold * target.n:
            ancestors = RESAMPLING[self.resampling](target.parents.weights, rng_streams["resampling"])
            log_weights = even_log_weights(target.n)
        target.clock.lap("resampling")
        state, correction = target.propose(ancestors, rng_streams["prior"])
        poses = target.prior.pose(state)
        log_weights, log_gain = target.weigh(log_weights, target.log_prob(poses, ancestors), correction)
        return target.moved(Particles(state, poses, log_weights, ancestors), log_gain)
