"""The posterior density of one frame over states with given parents, and particles that approximate it."""

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np

from workbench.core.frame import Frame
from workbench.core.likelihood import FrameLikelihood
from workbench.core.prior import Density, Prior, propose
from workbench.inference.smc.weights import DegenerateWeights, drop_undefined, effective_sample_size, logsumexp
from workbench.priors.density import phase_columns, state_difference
from workbench.utils.arrays import BoolArray, FloatArray, IntArray
from workbench.utils.errors import InputError
from workbench.utils.timing import working_s

ZERO_NOISE = 1e-12
"""Columns whose innovations are all smaller than this, in their unit, have no noise."""


class Stopwatch:
    """Elapsed seconds by stage."""

    def __init__(self) -> None:
        self.laps: dict[str, float] = {}
        self._last = working_s()

    def lap(self, stage: str) -> None:
        """Add the time since the last lap to this stage."""
        now = working_s()
        self.laps[stage] = self.laps.get(stage, 0.0) + now - self._last
        self._last = now


class Workspace:
    """Reusable buffers for parents, N rows each: allocating memory takes longer than writing it."""

    def __init__(self) -> None:
        self._buffers: dict[str, FloatArray] = {}

    def gather(self, name: str, values: FloatArray, rows: IntArray) -> FloatArray:
        """Return rows (N,) of values (M, K) in the buffer of this name, (N, K)."""
        buffer, shape = self._buffers.get(name), (len(rows), values.shape[1])
        if buffer is None or buffer.shape != shape:
            buffer = self._buffers[name] = np.empty(shape)
        return np.take(values, rows, axis=0, out=buffer, mode="clip")  # other modes copy first


@dataclass(frozen=True, eq=False)
class Particles:
    """N weighted states (N, D), their poses (N, P), normalised log weights (N,), and indices of their parents (N,)."""

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
    """N particles of a frame that do not represent its posterior yet.

    state: (N, D). poses: (N, P). parents: (N,) indices of the previous frame's particles. log_prior: (N,) log
    p(state | parent). log_prob: (N,) log likelihoods.
    """

    state: FloatArray
    poses: FloatArray
    parents: IntArray
    log_prior: FloatArray
    log_prob: FloatArray

    def select(self, indices: IntArray) -> "Candidates":
        """Return the candidates of these indices."""
        return Candidates(*(values[indices] for values in vars(self).values()))

    def merge(self, proposed: "Candidates", accepted: BoolArray) -> "Candidates":
        """Return the proposed candidates, of the same parents, where accepted (N,), these elsewhere."""
        pairs = zip(vars(proposed).values(), vars(self).values(), strict=True)
        return Candidates(*(np.where(accepted[:, None] if old.ndim > 1 else accepted, new, old) for new, old in pairs))


@dataclass(frozen=True, eq=False)
class MoveResult:
    """The particles of a frame after a move.

    log_gain: log p(frame | frames before), NaN if the move does not estimate it.
    evaluations: number of evaluations of the likelihood, one pose each.
    best: index of the particle whose pose is the step's `map_pose`; None: that with the largest weight.
    """

    particles: Particles
    log_gain: float = 0.0
    evaluations: float = 0.0
    warnings: tuple[str, ...] = ()
    diagnostics: Mapping[str, float] = field(default_factory=dict)
    best: int | None = None


@dataclass(eq=False)
class Target:
    """The density p(s_t | s_t−1) p(frame_t | s_t, s_t−1), where s_t−1 is one of the previous frame's particles.

    stop: raise DegenerateWeights if every weight of the frame is zero. workspace: the run's buffers for parents. It
    counts evaluations of the likelihood, collects warnings and the last evaluation's diagnostics, and measures time.
    """

    prior: Prior
    frame_likelihood: FrameLikelihood
    parents: Particles
    previous: Frame
    frame: Frame
    clock: Stopwatch
    stop: bool = False
    workspace: Workspace = field(default_factory=Workspace)
    evaluations: float = field(default=0.0, init=False)
    warnings: list[str] = field(default_factory=list, init=False)
    diagnostics: Mapping[str, float] = field(default_factory=dict, init=False)

    @property
    def n(self) -> int:
        """Return the number of particles N."""
        return len(self.parents.log_weights)

    @property
    def dt_s(self) -> float:
        """Return the seconds since the previous frame."""
        return self.frame.time_s - self.previous.time_s

    @property
    def density(self) -> Density:
        """Return the prior's density; raises InputError if it has none, see `density_of`."""
        return density_of(self.prior)

    def propose(self, parents: IntArray, rng: np.random.Generator) -> tuple[FloatArray, FloatArray]:
        """Sample a child (N, D) of each parent (N,) from the prior's proposal; return them and log weights (N,)."""
        before = self.workspace.gather("state", self.parents.state, parents)
        state, log_weights = propose(self.prior, before, self.dt_s, rng)
        return (state.copy() if np.may_share_memory(state, before) else state), log_weights  # as for dt 0

    def predict(self, parents: IntArray, rng: np.random.Generator) -> Candidates:
        """Sample a child of each of these parents (N,) from the prior."""
        return self.evaluate(self.prior.sample_transition(self.parents.state[parents], self.dt_s, rng), parents)

    def evaluate(self, state: FloatArray, parents: IntArray) -> Candidates:
        """Evaluate the density at states (N, D) with these parents (N,)."""
        log_prior = self.density.log_transition(self.parents.state[parents], state, self.dt_s)
        poses = self.prior.pose(state)
        return Candidates(state, poses, parents, log_prior, self.log_prob(poses, parents))

    def log_prob(self, poses: FloatArray, parents: IntArray) -> FloatArray:
        """Return log likelihoods (N,) of poses (N, P) with these parents (N,), −∞ where the likelihood is undefined."""
        self.clock.lap("prior")
        evaluation = self.frame_likelihood.evaluate(self.workspace.gather("poses", self.parents.poses, parents), poses)
        log_prob, undefined = drop_undefined(evaluation.log_prob)
        self.clock.lap("likelihood")
        self.evaluations += float(len(poses))
        self.warnings += [*(f"frame {self.frame.index}: {message}" for message in undefined), *evaluation.notes]
        self.diagnostics = evaluation.diagnostics
        return log_prob

    def reweight(
        self, log_weights: FloatArray, log_prob: FloatArray, correction: FloatArray | float = 0.0
    ) -> tuple[FloatArray, float]:
        """Return normalised log weights (N,) after log likelihoods (N,), and log p(frame | frames before).

        correction: (N,), log importance weights of a proposal. If every weight is zero, the log weights are unchanged
        and the evidence is 0, with a warning; raises DegenerateWeights instead if `stop`.
        """
        weighted = log_weights + correction + log_prob
        log_gain = logsumexp(weighted)
        if np.isfinite(log_gain):
            return weighted - log_gain, log_gain
        message = f"frame {self.frame.index}: no particle explains the image, every weight is zero"
        if self.stop:
            raise DegenerateWeights(message)
        self.warnings.append(f"{message}; the prior's prediction is used, evidence not counted")
        return log_weights, 0.0

    def free_columns(self) -> BoolArray:
        """Select (D,), the columns of the prior's density; the others follow from them, see `sample_dependent`."""
        free = np.zeros(len(self.prior.space), dtype=np.bool_)
        free[self.density.free] = True
        return free

    def noisy_columns(self, candidates: Candidates) -> BoolArray:
        """Select (D,), the free columns in which candidates differ from the prior's mean."""
        mean = self.density.mean(self.parents.state[candidates.parents], self.dt_s)
        return (
            np.abs(state_difference(self.prior.space, mean, candidates.state)).max(axis=0) > ZERO_NOISE
        ) & self.free_columns()

    def innovations(self, candidates: Candidates, noisy: BoolArray) -> tuple[FloatArray, FloatArray]:
        """Return the states' innovations (N, D') in the columns noisy (D,), and the prior's means (N, D').

        Means are relative to the first one.
        """
        mean = self.density.mean(self.parents.state[candidates.parents], self.dt_s)
        difference = state_difference(self.prior.space, mean, candidates.state)
        return difference[:, noisy], state_difference(self.prior.space, mean[0], mean)[:, noisy]

    def shift(self, candidates: Candidates, noisy: BoolArray, change: FloatArray) -> Candidates:
        """Return the candidates with their columns noisy (D,) changed by (N, D')."""
        state = candidates.state.copy()
        state[:, noisy] += change
        state[:, phase_columns(self.prior.space)] %= 1.0
        return self.evaluate(state, candidates.parents)

    def sample_dependent(self, candidates: Candidates, rng: np.random.Generator) -> Candidates:
        """Sample the columns that depend on the free ones; most priors have none."""
        before = self.parents.state[candidates.parents]
        return replace(candidates, state=self.density.sample_dependent(before, candidates.state, self.dt_s, rng))

    def result(self, particles: Particles, log_gain: float, **diagnostics: float) -> MoveResult:
        """Return the frame's particles with its evaluations, warnings and diagnostics."""
        warnings = tuple(dict.fromkeys(self.warnings))
        return MoveResult(particles, log_gain, self.evaluations, warnings, {**self.diagnostics, **diagnostics})

    def finalize(
        self, candidates: Candidates, log_weights: FloatArray, log_gain: float, **diagnostics: float
    ) -> MoveResult:
        """Return the candidates with log weights (N,) as the frame's particles.

        The best particle has the highest density, and `unique_particles` counts the parents that have offspring.
        """
        density = np.where(log_weights > -np.inf, candidates.log_prior + candidates.log_prob, -np.inf)
        particles = Particles(candidates.state, candidates.poses, log_weights, candidates.parents)
        distinct = float(len(np.unique(candidates.parents)))
        return replace(
            self.result(particles, log_gain, **diagnostics, unique_particles=distinct), best=int(np.argmax(density))
        )


def density_of(prior: Prior) -> Density:
    """Return the prior's density; raises InputError if its transitions have none that can be evaluated."""
    if prior.capabilities.density is None:
        raise InputError(
            "inference: expected a prior whose density can be evaluated, such as walking, cyclic, smooth or activity; "
            f"{type(prior).__name__.lower()} can only be sampled from"
        )
    return prior.capabilities.density
