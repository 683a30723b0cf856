"""Partitioned sampling: the body's parts are drawn and judged one after the other (MacCormick & Isard, Partitioned
Sampling, Articulated Objects, and Interface-Quality Hand Tracking, ECCV 2000)."""

from collections.abc import Iterable, Iterator, Mapping, Sequence

import numpy as np
from scipy.special import logsumexp

from workbench.arrays import FloatArray, IntArray
from workbench.body.skeleton import parameters as named_parameters
from workbench.datasets.frame import Frame
from workbench.errors import InputError
from workbench.inference.particle_filter import Advanced, Particles, Stopwatch, filtered, weigh
from workbench.inference.resampling import systematic
from workbench.inference.step import Step
from workbench.inference.target import Target, promise
from workbench.likelihoods.likelihood import Likelihood
from workbench.priors.jitter import with_density
from workbench.priors.state import Prior, StateSpace

PARTS = ("root", "lower_body", "upper_body")


class Partitioned:
    """A particle filter that draws the columns of a state part by part, and resamples after each:

        s^k ~ p(s^k_t | s_t−1),  resample by g_k / g_k−1,  g_k = p(frame_t | s^1 … s^k, μ^k+1 … μ^K)^flatten,  g_0 = 1

    where μ^k is where the prior's mean takes part k. After the last part w ∝ p(frame_t | s_t) / g_K−1, so that the
    posterior is exact and the evidence unbiased for any g. A particle that has the torso right is kept before its arms
    are drawn, so that one need not be lucky in all of them at once.

    Deviation: MacCormick & Isard judge a part by its own image alone. Here the whole body is shown, what is not drawn
    yet at its mean; that works with every likelihood and knows what hides what. flatten < 1, since the mean of the rest
    is not the rest.

    The columns must be independent of each other given the previous state, which those of all priors with a density
    are. The likelihood is evaluated for each part of each of the n_particles. parts: of parts of the body or parameters
    (`skeleton.PARTS`), in their order; velocities and offsets belong with their parameter, and what belongs to none,
    such as coefficients and a phase, to the first. Raises InputError for a prior without a density or whose columns
    are all in one part, for unknown parts, and numbers out of range.
    """

    def __init__(
        self,
        prior: Prior,
        likelihood: Likelihood,
        *,
        n_particles: int = 1500,
        flatten: float = 0.7,
        parts: Sequence[str] = PARTS,
    ) -> None:
        if n_particles < 1 or not 0.0 <= flatten <= 1.0:
            raise InputError(
                "inference: expected n_particles of at least 1 and flatten between 0 and 1, "
                f"found {n_particles} and {flatten}"
            )
        with_density(prior)
        self.prior, self.likelihood = prior, likelihood
        self.space: StateSpace = prior.space
        self.n_particles, self.flatten = n_particles, flatten
        self.columns = columns_of_parts(prior.space, parts)

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
        """Draw, judge and choose part by part; weigh the whole."""
        target = Target(self.prior, self.likelihood, parents, previous, frame, clock)
        even = np.full(self.n_particles, -np.log(self.n_particles))
        chosen = systematic(np.exp(parents.log_weights), rng_streams["resampling"])
        state = target.density.mean(parents.state[chosen], target.dt_s)
        promised, log_gain = np.zeros(self.n_particles), 0.0
        for last, columns in ((k == len(self.columns) - 1, part) for k, part in enumerate(self.columns)):
            drawn = self.prior.step(parents.state[chosen], target.dt_s, rng_streams["prior"])
            state[:, columns] = drawn[:, columns]
            pool = target.at(state, chosen)
            if last:
                break
            judged = promise(pool.log_prob, self.flatten)
            log_weights = even + judged - promised
            gained = float(logsumexp(log_weights))
            picked = systematic(np.exp(log_weights - gained), rng_streams["resampling"])
            state, chosen, promised, log_gain = state[picked], chosen[picked], judged[picked], log_gain + gained
            clock.lap("resampling")
        log_weights, gained, said = weigh(frame, even, pool.log_prob, log_gain - promised)
        target.warnings += said
        return pool.advanced(log_weights, gained, target)


def columns_of_parts(space: StateSpace, parts: Sequence[str]) -> list[IntArray]:
    """The columns of a state that belong to each part of the body that has some; see `Partitioned`."""
    names = [set(named_parameters("inference: parts", [part])) for part in parts]
    owners = np.zeros(len(space), dtype=np.int64)
    for column, name in enumerate(space.names):
        parameter = name.removesuffix("_jitter").removesuffix("_velocity")
        owners[column] = next((k for k, part in enumerate(names) if parameter in part), 0)
    if len(np.unique(owners)) < 2:
        raise InputError(
            "inference: parts must divide the prior's columns, all of which are in one part; choose a prior with "
            "columns for joint angles, such as smooth or jitter"
        )
    return [np.flatnonzero(owners == k) for k in np.unique(owners)]
