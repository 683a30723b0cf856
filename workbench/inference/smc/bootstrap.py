"""Moves with one sample per particle: bootstrap (Gordon, Salmond & Smith 1993), auxiliary (Pitt & Shephard 1999)."""

from dataclasses import dataclass
from typing import ClassVar

import numpy as np
import scipy

from workbench.core.capabilities import Traits, component_traits
from workbench.core.checks import UNIT, check, one_of
from workbench.core.prior import Prior
from workbench.inference.smc.move import DensityMove, InitialDiagnostics, Streams
from workbench.inference.smc.target import MoveResult, Particles, Target
from workbench.inference.smc.weights import RESAMPLING, lookahead_log_weight, systematic, uniform_log_weights


@dataclass(frozen=True)
class Bootstrap:
    """Sample from the posterior at t−1, propagate by the prior, weight by the likelihood (paper A, section 4.1).

    If the prior has a proposal (`core.prior.Proposing`), states are sampled from it and its correction enters the
    weights.

    resampling: systematic, multinomial or residual. ess_threshold: resample if the effective sample size is at most
    this fraction of N; 1 resamples before every frame, as the paper does. Raises InputError for other values.
    """

    traits: ClassVar[Traits] = component_traits()

    resampling: str = "systematic"
    ess_threshold: float = 1.0

    proposes: ClassVar[bool] = True

    def __post_init__(self) -> None:
        check("inference", self, resampling=one_of(*RESAMPLING), ess_threshold=UNIT)

    def check(self, prior: Prior, n_particles: int) -> None:
        """Accept every prior."""

    def initial_diagnostics(self, n_particles: int) -> InitialDiagnostics:
        """Return no diagnostics and no warnings."""
        return {}, ()

    def __call__(self, target: Target, rng_streams: Streams) -> MoveResult:
        """Resample, propagate, weight."""
        log_weights, ancestors = target.parents.log_weights, np.arange(target.n)
        if target.parents.ess <= self.ess_threshold * target.n:
            ancestors = RESAMPLING[self.resampling](target.parents.weights, rng_streams["resampling"])
            log_weights = uniform_log_weights(target.n)
        target.clock.lap("resampling")
        state, correction = target.propose(ancestors, rng_streams["prior"])
        poses = target.prior.pose(state)
        log_weights, log_gain = target.reweight(log_weights, target.log_prob(poses, ancestors), correction)
        return target.result(Particles(state, poses, log_weights, ancestors), log_gain)


@dataclass(frozen=True)
class Auxiliary(DensityMove):
    """Resample the parents by the likelihood of the states that the prior predicts without noise.

        λ_i ∝ w_i p(frame_t | μ_i)^γ,  a ~ λ,  s_t ~ p(s_t | s_t−1^a),
        w ∝ p(frame_t | s_t) / p(frame_t | μ_a)^γ

    μ_i is the prior's mean, γ the first_stage_power. Exact for every γ: 0 is the plain filter; 1 (Pitt & Shephard) has
    heavy-tailed weights if the likelihood is sharper than the prior's noise. The likelihood is evaluated twice for each
    particle. If the prior has a proposal, it is used and its correction enters the weights. Raises InputError for a
    prior without a density and a first_stage_power out of range.
    """

    first_stage_power: float = 0.5

    proposes: ClassVar[bool] = True

    def __post_init__(self) -> None:
        check("inference", self, first_stage_power=UNIT)

    def __call__(self, target: Target, rng_streams: Streams) -> MoveResult:
        """Compute the first-stage weights, resample the parents, propagate, weight."""
        parents = target.parents
        predicted = target.evaluate(target.density.mean(parents.state, target.dt_s), np.arange(target.n))
        first_stage = lookahead_log_weight(predicted.log_prob, self.first_stage_power)
        log_weights = parents.log_weights + first_stage
        log_sum = float(scipy.special.logsumexp(log_weights))
        ancestors = systematic(np.exp(log_weights - log_sum), rng_streams["resampling"])
        target.clock.lap("resampling")
        state, correction = target.propose(ancestors, rng_streams["prior"])
        candidates = target.evaluate(state, ancestors)
        correction = log_sum - first_stage[ancestors] + correction
        weighted = target.reweight(uniform_log_weights(target.n), candidates.log_prob, correction)
        return target.finalize(candidates, *weighted)
