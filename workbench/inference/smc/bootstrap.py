"""Moves with one draw a particle: bootstrap (Gordon, Salmond & Smith 1993), auxiliary (Pitt & Shephard 1999)."""

from dataclasses import dataclass
from typing import ClassVar

import numpy as np
import scipy

from workbench.core.capabilities import Traits, component_traits
from workbench.core.checks import UNIT, check, one_of
from workbench.core.prior import Prior
from workbench.inference.smc.move import DensityMove, First, Streams
from workbench.inference.smc.target import MoveResult, Particles, Target
from workbench.inference.smc.weights import RESAMPLING, even_log_weights, lookahead_log_weight, systematic


@dataclass(frozen=True)
class Bootstrap:
    """Draw from the posterior at t−1, propagate by the prior, weight by the likelihood (paper A, section 4.1).

    Where the prior draws from a proposal of its own (`core.prior.Proposing`), its correction enters the weights.

    resampling: systematic, multinomial or residual. ess_threshold: resample when the effective sample size falls to
    this fraction of N or below; 1 resamples before every frame, as the paper does. Raises InputError for others.
    """

    traits: ClassVar[Traits] = component_traits()

    resampling: str = "systematic"
    ess_threshold: float = 1.0

    proposes: ClassVar[bool] = True
    gathers: ClassVar[bool] = True

    def __post_init__(self) -> None:
        check("inference", self, resampling=one_of(*RESAMPLING), ess_threshold=UNIT)

    def check(self, prior: Prior, n_particles: int) -> None:
        """Accept every prior."""

    def first(self, n_particles: int) -> First:
        """Return no diagnostics and warnings of the first step."""
        return {}, ()

    def __call__(self, target: Target, rng_streams: Streams) -> MoveResult:
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


@dataclass(frozen=True)
class Auxiliary(DensityMove):
    """Choose parents by how likely the frame is where each of them leads without noise.

        λ_i ∝ w_i p(frame_t | μ_i)^flatten,  a ~ λ,  s_t ~ p(s_t | s_t−1^a),
        w ∝ p(frame_t | s_t) / p(frame_t | μ_a)^flatten

    μ_i is the prior's mean. Exact for every flatten: 0 is the plain filter; 1 (Pitt & Shephard) has heavy-tailed
    weights where the likelihood is sharper than the prior's noise. The likelihood is evaluated twice for each particle.
    A prior's own proposal is used, and its correction enters the weights. Raises InputError for a prior without a
    density and a flatten out of range."""

    first_stage_power: float = 0.5

    proposes: ClassVar[bool] = True

    def __post_init__(self) -> None:
        check("inference", self, first_stage_power=UNIT)

    def __call__(self, target: Target, rng_streams: Streams) -> MoveResult:
        """Look ahead, choose the parents, propagate, weigh."""
        parents = target.parents
        ahead = target.evaluate(target.density.mean(parents.state, target.dt_s), np.arange(target.n))
        bonus = lookahead_log_weight(ahead.log_prob, self.first_stage_power)
        first_stage = parents.log_weights + bonus
        log_sum = float(scipy.special.logsumexp(first_stage))
        chosen = systematic(np.exp(first_stage - log_sum), rng_streams["resampling"])
        target.clock.lap("resampling")
        state, correction = target.propose(chosen, rng_streams["prior"])
        drawn = target.evaluate(state, chosen)
        correction = log_sum - bonus[chosen] + correction
        return target.settle(drawn, *target.weigh(even_log_weights(target.n), drawn.log_prob, correction))
