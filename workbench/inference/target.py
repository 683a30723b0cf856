"""One frame's posterior as a density over states whose parents are given, and particles on their way to it."""

from dataclasses import dataclass

import numpy as np

from workbench.arrays import BoolArray, FloatArray, IntArray
from workbench.datasets.frame import Frame
from workbench.inference.particle_filter import Advanced, Particles, Stopwatch, defined
from workbench.likelihoods.likelihood import Likelihood
from workbench.priors.density import apart, circular
from workbench.priors.jitter import with_density
from workbench.priors.state import Prior

STILL = 1e-12
"""A column whose innovations are all smaller than this, in its unit, has no noise."""


@dataclass(frozen=True, eq=False)
class Pool:
    """N particles of a frame whose posterior is not reached yet.

    state: (N, D). poses: (N, P). parents: (N,) indices of the previous frame's particles. log_prior: (N,) log
    p(state | parent). log_prob: (N,) log likelihoods.
    """

    state: FloatArray
    poses: FloatArray
    parents: IntArray
    log_prior: FloatArray
    log_prob: FloatArray

    def picked(self, which: IntArray) -> "Pool":
        """The particles of these indices."""
        return Pool(
            self.state[which], self.poses[which], self.parents[which], self.log_prior[which], self.log_prob[which]
        )

    def merged(self, other: "Pool", taken: BoolArray) -> "Pool":
        """The other's particles, of the same parents, where taken (N,), these elsewhere."""
        rows = taken[:, None]
        return Pool(
            np.where(rows, other.state, self.state),
            np.where(rows, other.poses, self.poses),
            self.parents,
            np.where(taken, other.log_prior, self.log_prior),
            np.where(taken, other.log_prob, self.log_prob),
        )

    def advanced(self, log_weights: FloatArray, log_gain: float, target: "Target", **diagnostics: float) -> Advanced:
        """The step's particles with these log weights (N,); its best is the one with the highest density."""
        density = np.where(log_weights > -np.inf, self.log_prior + self.log_prob, -np.inf)
        return Advanced(
            Particles(self.state, self.poses, log_weights, self.parents),
            log_gain,
            target.evaluations,
            tuple(dict.fromkeys(target.warnings)),
            {**diagnostics, "distinct": float(len(np.unique(self.parents)))},
            int(np.argmax(density)),
        )


class Target:
    """The density p(s_t | s_t−1) p(frame_t | s_t, s_t−1), s_t−1 being one of the previous frame's particles.

    Counts the evaluations of the likelihood, collects its warnings, and keeps the time. The prior must have a density.
    """

    def __init__(
        self,
        prior: Prior,
        likelihood: Likelihood,
        parents: Particles,
        previous: Frame,
        frame: Frame,
        clock: Stopwatch,
    ) -> None:
        self.prior, self.density, self.likelihood = prior, with_density(prior), likelihood
        self.parents, self.previous, self.frame = parents, previous, frame
        self.dt_s = frame.time_s - previous.time_s
        self.evaluations, self.warnings = 0.0, list[str]()
        self._clock = clock

    def predicted(self, parents: IntArray, rng: np.random.Generator) -> Pool:
        """A child, drawn by the prior, of each of these parents (N,)."""
        return self.at(self.prior.step(self.parents.state[parents], self.dt_s, rng), parents)

    def at(self, state: FloatArray, parents: IntArray) -> Pool:
        """The density at states (N, D) with these parents (N,)."""
        log_prior = self.density.log_transition(self.parents.state[parents], state, self.dt_s)
        poses = self.prior.pose(state)
        self._clock.lap("prior")
        log_prob = self.likelihood.log_prob(self.previous, self.frame, self.parents.poses[parents], poses)
        log_prob, said = defined(self.frame, log_prob)
        self._clock.lap("likelihood")
        self.evaluations += float(len(state))
        self.warnings += [*said, *self.likelihood.warnings()]
        return Pool(state, poses, parents, log_prior, log_prob)

    def innovations(self, pool: Pool) -> tuple[FloatArray, FloatArray, BoolArray]:
        """Of the columns that have noise: how far the states are from where their parents lead without it, (N, D');
        where that is, relative to the first one, (N, D'); and which columns these are, (D,)."""
        mean = self.density.mean(self.parents.state[pool.parents], self.dt_s)
        noisy = np.abs(apart(self.prior.space, mean, pool.state)).max(axis=0) > STILL
        return *self.innovations_of(pool, noisy), noisy

    def innovations_of(self, pool: Pool, noisy: BoolArray) -> tuple[FloatArray, FloatArray]:
        """The first two of `innovations`, of these columns (D,)."""
        mean = self.density.mean(self.parents.state[pool.parents], self.dt_s)
        difference = apart(self.prior.space, mean, pool.state)
        return difference[:, noisy], apart(self.prior.space, mean[0], mean)[:, noisy]

    def nudged(self, pool: Pool, noisy: BoolArray, change: FloatArray) -> Pool:
        """The density at the pool's states after a change (N, D') of the columns that have noise."""
        state = pool.state.copy()
        state[:, noisy] += change
        state[:, circular(self.prior.space)] %= 1.0
        return self.at(state, pool.parents)


def promise(log_prob: FloatArray, flatten: float) -> FloatArray:
    """Log likelihoods (N,) of states on their way, to the power `flatten`, to choose particles by.

    One that is impossible may lead to possible ones: it keeps the least of the finite values.
    """
    possible = np.isfinite(log_prob)
    floor = log_prob[possible].min() if possible.any() else 0.0
    promised: FloatArray = flatten * np.where(possible, log_prob, floor)
    return promised
