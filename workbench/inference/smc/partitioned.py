"""Partitioned sampling's move: the body's parts are drawn and judged one after the other (MacCormick & Isard,
Partitioned Sampling, Articulated Objects, and Interface-Quality Hand Tracking, ECCV 2000)."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import ClassVar

import numpy as np
import scipy

from workbench.body.skeleton import parameters as named_parameters
from workbench.core.capabilities import BODY_PARTS, DENSITY, SEPARABLE, Traits, offering
from workbench.core.checks import UNIT, check
from workbench.core.prior import Prior
from workbench.core.state_space import StateSpace
from workbench.inference.smc.move import DensityMove, Streams
from workbench.inference.smc.target import MoveResult, Target, density_of
from workbench.inference.smc.weights import even_log_weights, lookahead_log_weight, systematic
from workbench.utils.arrays import IntArray
from workbench.utils.errors import InputError

PARTS = ("root", "lower_body", "upper_body")


@dataclass(frozen=True)
class Partitioned(DensityMove):
    """Draw the columns of a state part by part, and resample after each:

        s^k ~ p(s^k_t | s_t−1),  resample by g_k / g_k−1,  g_k = p(frame_t | s^1 … s^k, μ^k+1 … μ^K)^flatten,  g_0 = 1

    where μ^k is the prior's mean of part k. After the last part w ∝ p(frame_t | s_t) / g_K−1, so that the posterior is
    exact and the evidence unbiased for any g. The likelihood is evaluated for each part of each particle. The columns
    must be independent of each other given the previous state (`core.prior.Density.free`).

    Deviation: MacCormick & Isard judge a part by its own image alone. Here the whole body is shown, with what is not
    drawn yet at its mean, so that every likelihood can be used and occlusion is known.

    parts: of parts of the body or parameters (`skeleton.PARTS`), in their order; velocities and offsets belong with
    their parameter, other columns to the first part. Raises InputError for a prior without a density, or whose columns
    are dependent or all in one part, for unknown parts, and a flatten out of range."""

    traits: ClassVar[Traits] = offering(prior=(DENSITY, SEPARABLE, BODY_PARTS))

    flatten: float = 0.7
    parts: Sequence[str] = PARTS

    def __post_init__(self) -> None:
        check("inference", self, flatten=UNIT)

    def check(self, prior: Prior, n_particles: int) -> None:
        """Raise InputError for a prior without a density, and columns that the parts do not divide."""
        super().check(prior, n_particles)
        if len(density_of(prior).free) < len(prior.space):
            raise InputError(
                "inference: parts are drawn one after the other, which takes a prior whose columns are independent of "
                f"each other given the previous state; those of {type(prior).__name__.lower()} are not"
            )
        columns_of_parts(prior.space, self.parts)

    def __call__(self, target: Target, rng_streams: Streams) -> MoveResult:
        """Draw, judge and choose part by part; weigh the whole."""
        even, prior, parents = even_log_weights(target.n), target.prior, target.parents
        resampling, rng = rng_streams["resampling"], rng_streams["prior"]
        chosen = systematic(np.exp(parents.log_weights), resampling)
        state = target.density.mean(parents.state[chosen], target.dt_s)
        previous_judged, log_gain = np.zeros(target.n), 0.0
        *first_parts, last_part = columns_of_parts(prior.space, self.parts)
        for columns in first_parts:
            state[:, columns] = prior.sample_transition(parents.state[chosen], target.dt_s, rng)[:, columns]
            judged = lookahead_log_weight(target.evaluate(state, chosen).log_prob, self.flatten)
            log_weights = even + judged - previous_judged
            gained = float(scipy.special.logsumexp(log_weights))
            picked = systematic(np.exp(log_weights - gained), resampling)
            state, chosen, previous_judged, log_gain = state[picked], chosen[picked], judged[picked], log_gain + gained
            target.clock.lap("resampling")
        state[:, last_part] = prior.sample_transition(parents.state[chosen], target.dt_s, rng)[:, last_part]
        drawn = target.evaluate(state, chosen)
        return target.settle(drawn, *target.weigh(even, drawn.log_prob, log_gain - previous_judged))


def columns_of_parts(space: StateSpace, parts: Sequence[str]) -> list[IntArray]:
    """Find the columns of a state that belong to each part of the body that has some; see `Partitioned`."""
    names = [set(named_parameters("inference: parts", [part])) for part in parts]
    owners = np.zeros(len(space), dtype=np.int64)
    for column, name in enumerate(space.names):
        parameter = name.removesuffix("_offset").removesuffix("_velocity")
        owners[column] = next((k for k, part in enumerate(names) if parameter in part), 0)
    if len(np.unique(owners)) < 2:
        raise InputError(
            "inference: parts must divide the prior's columns, all of which are in one part; choose a prior with "
            "columns for joint angles, such as smooth or ar_offsets"
        )
    return [np.flatnonzero(owners == k) for k in np.unique(owners)]
