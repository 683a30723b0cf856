"""One frame's posterior as a density over states whose parents are given, and particles on their way to it."""

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np

from workbench.core.frame import Frame
from workbench.core.likelihood import FrameLikelihood
from workbench.core.prior import Density, Prior, propose
from workbench.inference.smc.weights import DegenerateWeights, drop_undefined, effective_sample_size, logsumexp
from workbench.priors.density import apart, circular
from workbench.utils.arrays import BoolArray, FloatArray, IntArray
from workbench.utils.errors import InputError
from workbench.utils.timing import working_s

STILL = 1e-12
"""A column whose innovations are all smaller than this, in its unit, has no noise."""


class Stopwatch:
    """Seconds since the last lap, by stage."""

    def __init__(self) -> None:
        self.laps: dict[str, float] = {}
        self._last = working_s()

    def lap(self, stage: str) -> None:
        """Count the time since the last lap for this stage."""
        now = working_s()
        self.laps[stage] = self.laps.get(stage, 0.0) + now - self._last
        self._last = now


class Workspace:
    """Memory for parents, N rows each, that every frame writes anew: fresh memory takes longer than what is written."""

    def __init__(self) -> None:
        self._kept: dict[str, FloatArray] = {}

    def rows(self, name: str, values: FloatArray, which: IntArray) -> FloatArray:
        """Gather rows `which` (N,) of values (M, K) into the memory of this name, (N, K)."""
        kept, shape = self._kept.get(name), (len(which), values.shape[1])
        if kept is None or kept.shape != shape:
            kept = self._kept[name] = np.empty(shape)
        return np.take(values, which, axis=0, out=kept, mode="clip")  # else by way of a copy


@dataclass(frozen=True, eq=False)
class Particles:
    """N weighted states (N, D), their poses (N, P), normalised log weights (N,), and each one's parent (N,)."""

    state: FloatArray
    poses: FloatArray
    log_weights: FloatArray
    ancestors: IntArray

    @cached_property
    def weights(self) -> FloatArray:
        """Return the weights (N,)."""
        weights: FloatArray = np.exp(self.log_weights)
        return weights

    @cached_property
    def ess(self) -> float:
        """Return the effective sample size."""
        return effective_sample_size(self.log_weights)


@dataclass(frozen=True, eq=False)
class Candidates:
    """N particles of a frame whose posterior is not reached yet.

    state: (N, D). poses: (N, P). parents: (N,) indices of the previous frame's particles. log_prior: (N,) log
    p(state | parent). log_prob: (N,) log likelihoods.
    """

    state: FloatArray
    poses: FloatArray
    parents: IntArray
    log_prior: FloatArray
    log_prob: FloatArray

    def pick(self, which: IntArray) -> "Candidates":
        """Gather the candidates of these indices."""
        return Candidates(*(values[which] for values in vars(self).values()))

    def merge(self, other: "Candidates", taken: BoolArray) -> "Candidates":
        """Take the other's candidates, of the same parents, where taken (N,), these elsewhere."""
        pairs = zip(vars(other).values(), vars(self).values(), strict=True)
        return Candidates(*(np.where(taken[:, None] if own.ndim > 1 else taken, new, own) for new, own in pairs))


@dataclass(frozen=True, eq=False)
class MoveResult:
    """What a move makes of the particles in one more frame.

    log_gain: log p(frame | frames before), NaN by moves that do not estimate it.
    evaluations: how often the likelihood was evaluated, for one pose each.
    best: index of the particle whose pose is the step's `map_pose`; None: the heaviest.
    """

    particles: Particles
    log_gain: float = 0.0
    evaluations: float = 0.0
    warnings: tuple[str, ...] = ()
    diagnostics: Mapping[str, float] = field(default_factory=dict)
    best: int | None = None


@dataclass(eq=False)
class Target:
    """The density p(s_t | s_t−1) p(frame_t | s_t, s_t−1), s_t−1 being one of the previous frame's particles.

    stop: raise DegenerateWeights where no particle explains the frame. room: memory of the run for parents. Counts the
    evaluations of the likelihood, collects warnings and what the last evaluation came with, and keeps the time.
    """

    prior: Prior
    frame_likelihood: FrameLikelihood
    parents: Particles
    previous: Frame
    frame: Frame
    clock: Stopwatch
    stop: bool = False
    room: Workspace = field(default_factory=Workspace)
    evaluations: float = field(default=0.0, init=False)
    warnings: list[str] = field(default_factory=list, init=False)
    diagnostics: Mapping[str, float] = field(default_factory=dict, init=False)

    @property
    def n(self) -> int:
        """Return the number of particles N."""
        return len(self.parents.log_weights)

    @property
    def dt_s(self) -> float:
        """Return seconds since the previous frame."""
        return self.frame.time_s - self.previous.time_s

    @property
    def density(self) -> Density:
        """Return the prior's density; raises InputError where it has none, see `density_of`."""
        return density_of(self.prior)

    def propose(self, parents: IntArray, rng: np.random.Generator) -> tuple[FloatArray, FloatArray]:
        """Draw a child (N, D) of each of these parents (N,) by the prior's proposal; returns its log weights (N,)
        too."""
        before = self.room.rows("state", self.parents.state, parents)
        state, log_weights = propose(self.prior, before, self.dt_s, rng)
        return (state.copy() if np.may_share_memory(state, before) else state), log_weights  # as after no time

    def predict(self, parents: IntArray, rng: np.random.Generator) -> Candidates:
        """Draw a child of each of these parents (N,) by the prior."""
        return self.evaluate(self.prior.sample_transition(self.parents.state[parents], self.dt_s, rng), parents)

    def evaluate(self, state: FloatArray, parents: IntArray) -> Candidates:
        """Evaluate the density at states (N, D) with these parents (N,)."""
        log_prior = self.density.log_transition(self.parents.state[parents], state, self.dt_s)
        poses = self.prior.pose(state)
        return Candidates(state, poses, parents, log_prior, self.log_prob(poses, parents))

    def log_prob(self, poses: FloatArray, parents: IntArray) -> FloatArray:
        """Return log likelihoods (N,) of poses (N, P) with these parents (N,), −∞ where the likelihood is undefined."""
        self.clock.lap("prior")
        evaluation = self.frame_likelihood.evaluate(self.room.rows("poses", self.parents.poses, parents), poses)
        log_prob, undefined = drop_undefined(evaluation.log_prob)
        self.clock.lap("likelihood")
        self.evaluations += float(len(poses))
        self.warnings += [*(f"frame {self.frame.index}: {sentence}" for sentence in undefined), *evaluation.notes]
        self.diagnostics = evaluation.diagnostics
        return log_prob

    def weigh(
        self, log_weights: FloatArray, log_prob: FloatArray, correction: FloatArray | float = 0.0
    ) -> tuple[FloatArray, float]:
        """Normalise log weights (N,) after log likelihoods (N,) and corrections (N,) for a proposal.

        Returns them and log p(frame | frames before); as they were, and 0, with a warning, where every weight is zero.
        Raises DegenerateWeights there if told to stop.
        """
        weighted = log_weights + correction + log_prob
        log_gain = logsumexp(weighted)
        if np.isfinite(log_gain):
            return weighted - log_gain, log_gain
        sentence = f"frame {self.frame.index}: no particle explains the image, every weight is zero"
        if self.stop:
            raise DegenerateWeights(sentence)
        self.warnings.append(f"{sentence}; kept the prior's prediction, evidence not counted")
        return log_weights, 0.0

    def free(self) -> BoolArray:
        """Select (D,), the columns that the prior's density speaks of; the others follow from them, see
        `sample_dependent`."""
        free = np.zeros(len(self.prior.space), dtype=np.bool_)
        free[self.density.free] = True
        return free

    def noisy(self, candidates: Candidates) -> BoolArray:
        """Select (D,), the free columns in which candidates are not where their parents lead without noise."""
        mean = self.density.mean(self.parents.state[candidates.parents], self.dt_s)
        return (np.abs(apart(self.prior.space, mean, candidates.state)).max(axis=0) > STILL) & self.free()

    def innovations(self, candidates: Candidates, noisy: BoolArray) -> tuple[FloatArray, FloatArray]:
        """Return, in the columns noisy (D,), how far the states are from where their parents lead without noise, (N,
        D'), and where that is, relative to the first one, (N, D')."""
        mean = self.density.mean(self.parents.state[candidates.parents], self.dt_s)
        difference = apart(self.prior.space, mean, candidates.state)
        return difference[:, noisy], apart(self.prior.space, mean[0], mean)[:, noisy]

    def shift(self, candidates: Candidates, noisy: BoolArray, change: FloatArray) -> Candidates:
        """Evaluate the density at the candidates' states after a change (N, D') of the columns noisy (D,)."""
        state = candidates.state.copy()
        state[:, noisy] += change
        state[:, circular(self.prior.space)] %= 1.0
        return self.evaluate(state, candidates.parents)

    def sample_dependent(self, candidates: Candidates, rng: np.random.Generator) -> Candidates:
        """Draw the columns that follow from the free ones; none for most priors."""
        before = self.parents.state[candidates.parents]
        return replace(candidates, state=self.density.sample_dependent(before, candidates.state, self.dt_s, rng))

    def moved(self, particles: Particles, log_gain: float, **diagnostics: float) -> MoveResult:
        """Hand back the frame's particles, with what was counted and collected on the way."""
        warnings = tuple(dict.fromkeys(self.warnings))
        return MoveResult(particles, log_gain, self.evaluations, warnings, {**self.diagnostics, **diagnostics})

    def settle(self, chosen: Candidates, log_weights: FloatArray, log_gain: float, **diagnostics: float) -> MoveResult:
        """Hand back candidates with these log weights (N,) as the frame's particles; the best is the one with the
        highest density, and `unique_particles` counts the parents that have offspring."""
        density = np.where(log_weights > -np.inf, chosen.log_prior + chosen.log_prob, -np.inf)
        particles = Particles(chosen.state, chosen.poses, log_weights, chosen.parents)
        distinct = float(len(np.unique(chosen.parents)))
        return replace(
            self.moved(particles, log_gain, **diagnostics, unique_particles=distinct), best=int(np.argmax(density))
        )


def density_of(prior: Prior) -> Density:
    """Return the prior's density; raises InputError where its transitions have none that could be evaluated."""
    if prior.capabilities.density is None:
        raise InputError(
            "inference: it needs a prior whose density can be evaluated, such as walking, cyclic, smooth or activity; "
            f"{type(prior).__name__.lower()} can only be drawn from"
        )
    return prior.capabilities.density
