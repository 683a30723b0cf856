"""The auxiliary particle filter's move: look at the frame before choosing who goes on (Pitt & Shephard 1999)."""

from dataclasses import dataclass
from typing import ClassVar

import numpy as np
import scipy

from workbench.core.checks import UNIT, check
from workbench.inference.smc.move import DensityMove, Streams
from workbench.inference.smc.target import Moved, Target
from workbench.inference.smc.weights import even_log_weights, lookahead_log_weight, systematic


@dataclass(frozen=True)
class Auxiliary(DensityMove):
    """Choose parents by how likely the frame is where each of them leads without noise.

        λ_i ∝ w_i p(frame_t | μ_i)^flatten,  a ~ λ,  s_t ~ p(s_t | s_t−1^a),
        w ∝ p(frame_t | s_t) / p(frame_t | μ_a)^flatten

    μ_i is the prior's mean. Exact for every flatten: 0 is the plain filter; 1 (Pitt & Shephard) trusts the look ahead
    fully, which makes weights heavy-tailed where the likelihood is sharper than the prior's noise. The likelihood is
    evaluated twice for each particle. A prior's own proposal is drawn from, and its correction enters the weights.
    Raises InputError for a prior without a density and a flatten out of range.
    """

    flatten: float = 0.5

    proposes: ClassVar[bool] = True

    def __post_init__(self) -> None:
        check("inference", self, flatten=UNIT)

    def __call__(self, target: Target, rng_streams: Streams) -> Moved:
        """Look ahead, choose the parents, propagate, weigh."""
        parents = target.parents
        ahead = target.evaluate(target.density.mean(parents.state, target.dt_s), np.arange(target.n))
        bonus = lookahead_log_weight(ahead.log_prob, self.flatten)
        first_stage = parents.log_weights + bonus
        log_sum = float(scipy.special.logsumexp(first_stage))
        chosen = systematic(np.exp(first_stage - log_sum), rng_streams["resampling"])
        target.clock.lap("resampling")
        state, correction = target.propose(chosen, rng_streams["prior"])
        drawn = target.evaluate(state, chosen)
        correction = log_sum - bonus[chosen] + correction
        return target.settle(drawn, *target.weigh(even_log_weights(target.n), drawn.log_prob, correction))
