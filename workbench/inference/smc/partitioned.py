"""The move of partitioned sampling: partitions of the state are sampled and weighted one after the other (MacCormick &
Isard, Partitioned Sampling, Articulated Objects, and Interface-Quality Hand Tracking, ECCV 2000)."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import ClassVar

import numpy as np
import scipy

from workbench.body.skeleton import parameters as named_parameters
from workbench.core.capabilities import BODY_PARTS, DENSITY, SEPARABLE, Traits, component_traits
from workbench.core.checks import UNIT, check
from workbench.core.prior import Prior
from workbench.core.state_space import StateSpace
from workbench.inference.smc.move import DensityMove, Streams
from workbench.inference.smc.target import MoveResult, Target, density_of
from workbench.inference.smc.weights import lookahead_log_weight, systematic, uniform_log_weights
from workbench.utils.arrays import IntArray
from workbench.utils.errors import InputError

PARTS = ("root", "lower_body", "upper_body")


@dataclass(frozen=True)
class Partitioned(DensityMove):
    """Sample the columns of a state partition by partition, and resample after each:

        s^k ~ p(s^k_t | s_t−1),  resample by g_k / g_k−1,  g_k = p(frame_t | s^1 … s^k, μ^k+1 … μ^K)^γ,  g_0 = 1

    with the prior's mean μ^k of partition k and γ = intermediate_power. After the last partition
    w ∝ p(frame_t | s_t) / g_K−1, so that the posterior is exact and the evidence unbiased for any g. The likelihood is
    evaluated once for each partition of each particle. The columns must be independent of each other given the previous
    state (`core.prior.Density.free`).

    Deviation: MacCormick & Isard weight a partition by its own image alone. Here the whole body is rendered, with
    partitions that are not sampled yet at their mean, so that every likelihood applies and occlusion is modelled.

    partitions: body parts or parameters (`skeleton.PARTS`), in their order; velocities and offsets belong with their
    parameter, other columns to the first partition. Raises InputError for a prior without a density, or whose columns
    are dependent or all in one partition, for unknown parts, and an intermediate_power out of range.
    """

    traits: ClassVar[Traits] = component_traits(prior=(DENSITY, SEPARABLE, BODY_PARTS))

    intermediate_power: float = 0.7
    partitions: Sequence[str] = PARTS

    def __post_init__(self) -> None:
        check("inference", self, intermediate_power=UNIT)

    def check(self, prior: Prior, n_particles: int) -> None:
        """Raise InputError for a prior without a density, and columns that the partitions do not divide."""
        super().check(prior, n_particles)
        if len(density_of(prior).free) < len(prior.space):
            raise InputError(
                "inference: partitioned sampling needs a prior whose columns are independent given the previous "
                f"state; those of {type(prior).__name__.lower()} are not"
            )
        partition_columns(prior.space, self.partitions)

    def __call__(self, target: Target, rng_streams: Streams) -> MoveResult:
        """Sample, weight and resample each partition; weight the whole."""
        uniform, prior, parents = uniform_log_weights(target.n), target.prior, target.parents
        resampling, rng = rng_streams["resampling"], rng_streams["prior"]
        ancestors = systematic(np.exp(parents.log_weights), resampling)
        state = target.density.mean(parents.state[ancestors], target.dt_s)
        previous, log_gain = np.zeros(target.n), 0.0
        *first_partitions, last_partition = partition_columns(prior.space, self.partitions)
        for columns in first_partitions:
            state[:, columns] = prior.sample_transition(parents.state[ancestors], target.dt_s, rng)[:, columns]
            log_intermediate = lookahead_log_weight(target.evaluate(state, ancestors).log_prob, self.intermediate_power)
            log_weights = uniform + log_intermediate - previous
            log_sum = float(scipy.special.logsumexp(log_weights))
            picked = systematic(np.exp(log_weights - log_sum), resampling)
            state, ancestors, previous = state[picked], ancestors[picked], log_intermediate[picked]
            log_gain += log_sum
            target.clock.lap("resampling")
        sampled = prior.sample_transition(parents.state[ancestors], target.dt_s, rng)
        state[:, last_partition] = sampled[:, last_partition]
        candidates = target.evaluate(state, ancestors)
        return target.finalize(candidates, *target.reweight(uniform, candidates.log_prob, log_gain - previous))


def partition_columns(space: StateSpace, partitions: Sequence[str]) -> list[IntArray]:
    """Return the columns of a state that belong to each partition that has some; see `Partitioned`."""
    names = [set(named_parameters("inference: partitions", [part])) for part in partitions]
    owners = np.zeros(len(space), dtype=np.int64)
    for column, name in enumerate(space.names):
        parameter = name.removesuffix("_offset").removesuffix("_velocity")
        owners[column] = next((k for k, part in enumerate(names) if parameter in part), 0)
    if len(np.unique(owners)) < 2:
        raise InputError(
            "inference: partitions must divide the prior's columns, all of which are in one partition; choose a prior "
            "with columns for joint angles, such as smooth or ar_offsets"
        )
    return [np.flatnonzero(owners == k) for k in np.unique(owners)]
