"""The particle filter: sequential importance resampling (Doucet, de Freitas & Gordon 2001), whatever moves it."""

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import KW_ONLY, dataclass, replace
from typing import Any, ClassVar, Literal, Self

import numpy as np

from workbench.body.angles import nearest_turn
from workbench.core.capabilities import START, Traits, needs_of_all, offering
from workbench.core.checks import at_least, check, one_of
from workbench.core.filter_state import Memory, Past, recalled, streams_now
from workbench.core.frame import Frame
from workbench.core.likelihood import Likelihood
from workbench.core.prior import Prior
from workbench.core.state_space import StateSpace
from workbench.core.step import Step
from workbench.inference.smc.bootstrap import Bootstrap
from workbench.inference.smc.move import Move, Streams
from workbench.inference.smc.target import MoveResult, Particles, Stopwatch, Target, Workspace
from workbench.inference.smc.weights import DegenerateWeights as DegenerateWeights
from workbench.inference.smc.weights import even_log_weights, systematic
from workbench.utils.arrays import AnyArray, FloatArray, IntArray
from workbench.utils.errors import InputError

LOOKED_BACK = 10
"""Frames over which the diagnostic `unique_ancestors_lag10` follows the particles back: their weights may be even and
they all have come from one."""


@dataclass(frozen=True, eq=False)
class ParticleFilter:
    """Represent each frame's posterior by N weighted particles, which a move makes of those of the frame before.

    move: how parents are chosen, states drawn and weighted. n_particles: N. on_degenerate: what to do when every weight
    of a frame is zero or undefined: "recover" keeps the prior's prediction with even weights, or those of the frame
    before, and says so, "stop" raises DegenerateWeights. Raises InputError for other values and a prior without what
    the move needs.
    """

    @staticmethod
    def traits(keys: Mapping[str, Any]) -> Traits:
        """Declare the need of a prior, a likelihood and a start, and what the move needs."""
        own = offering(dataset=START, prior=(), likelihood=())
        return Traits(requires=needs_of_all({"filter": own, "move": keys["move"] or Traits()}))

    prior: Prior
    likelihood: Likelihood
    _: KW_ONLY
    move: Move = Bootstrap()  # noqa: RUF009 - frozen
    n_particles: int = 5000
    on_degenerate: str = "recover"

    kind: ClassVar[Literal["filtered"]] = "filtered"
    finds_start: ClassVar[bool] = False
    resumable: ClassVar[bool] = True

    def __post_init__(self) -> None:
        check("inference", self, n_particles=at_least(1), on_degenerate=one_of("recover", "stop"))
        self.move.check(self.prior, self.n_particles)

    @property
    def space(self) -> StateSpace:
        """Return the prior's."""
        return self.prior.space

    def rebuilt(self, **parts: Any) -> Self:
        """Replace parts, such as the prior, the move or n_particles."""
        return replace(self, **parts)

    def run(self, frames: Iterable[Frame], start: FloatArray | Past | None, rng_streams: Streams) -> Iterator[Step]:
        """Yield one step per frame; the first gives the start distribution around the pose `start` (P,), unweighted, or
        in even parts around each of the poses (n, P); or the steps of the frames after a `Past`, whose particles are
        resampled where there are more or fewer than n_particles (ancestors are then among those resampled).

        rng_streams: generators named "start", "resampling" and "prior". Raises InputError without a start, and
        DegenerateWeights as configured.
        """
        likelihood, log_evidence, frames, room = self.likelihood, 0.0, iter(frames), Workspace()
        origins: AnyArray = np.empty((0, self.n_particles), dtype=np.int32)
        previous: Frame | None = None
        if isinstance(start, Past):
            likelihood, previous = recalled(likelihood, frames, start.expected)
            moved, origins, log_evidence = self._restored(start.memory, rng_streams)
        for frame in frames:
            clock = Stopwatch()
            frame_likelihood = likelihood.prepare(previous, frame)
            clock.lap("likelihood")
            if previous is None:
                moved = self._start(start, rng_streams["start"])
                clock.lap("prior")
            else:
                stop = self.on_degenerate == "stop"
                moved = self.move(
                    Target(self.prior, frame_likelihood, moved.particles, previous, frame, clock, stop, room),
                    rng_streams,
                )
            origins = traced(origins, moved.particles.ancestors)
            counted = {"unique_ancestors_lag10": float(np.count_nonzero(np.bincount(origins[-1])))}
            diagnostics, warnings = (
                {**frame_likelihood.diagnostics, **moved.diagnostics, **counted},
                (*frame_likelihood.notes, *moved.warnings),
            )
            moved = replace(moved, warnings=warnings, diagnostics=diagnostics)
            log_evidence += moved.log_gain
            step = _particle_step(frame, self.space, moved, log_evidence, clock)
            likelihood = frame_likelihood.update(step.expected_pose)
            clock.lap("likelihood")
            memory = self._memory(moved.particles, origins, log_evidence, step.expected_pose, rng_streams)
            yield replace(step, timing_s=clock.laps, memory=memory)
            previous = frame

    def _start(self, poses: FloatArray | Past | None, rng: np.random.Generator) -> MoveResult:
        """Return even particles around poses (P,) or (n, P). Names in `run` would hold them until the last frame."""
        if poses is None or isinstance(poses, Past):
            raise InputError("inference: a particle filter needs a pose to start from, found none")
        state = start_around(self.prior, np.atleast_2d(poses), self.n_particles, rng)
        even, own = even_log_weights(self.n_particles), np.arange(self.n_particles)
        diagnostics, warnings = self.move.first(self.n_particles)
        return MoveResult(
            Particles(state, self.prior.pose(state), even, own), diagnostics=diagnostics, warnings=warnings
        )

    def _memory(
        self, particles: Particles, origins: AnyArray, log_evidence: float, expected: FloatArray, rng_streams: Streams
    ) -> Memory:
        """Return what the filter goes on from after a frame."""
        arrays = {
            "state": particles.state, "poses": particles.poses, "log_weights": particles.log_weights,
            "origins": origins, "log_evidence": np.array([log_evidence]),
        }  # fmt: skip
        parents = particles.ancestors if self.move.gathers else None
        return Memory(arrays, expected, streams_now(rng_streams), parents)

    def _restored(self, memory: Memory, rng_streams: Streams) -> tuple[MoveResult, AnyArray, float]:
        """Return particles, their origins and the log evidence as a memory has them, and set the streams. Poses that it
        does not have are what the prior makes of its states."""
        memory.restore(rng_streams)
        state, log_weights = memory.array("state", None, len(self.space)), memory.array("log_weights", None)
        n, (log_evidence,) = len(log_weights), memory.array("log_evidence", 1)
        poses = memory.array("poses", n, None) if "poses" in memory.arrays else self.prior.pose(state)
        particles, origins = Particles(state, poses, log_weights, np.arange(n)), memory.array("origins", None, n)
        if len(state) != n:
            raise InputError(f"checkpoint: expected {n} states, as there are weights, found {len(state)}")
        if n != self.n_particles:
            picked = systematic(np.exp(log_weights), rng_streams["resampling"], self.n_particles)
            particles = Particles(state[picked], poses[picked], even_log_weights(self.n_particles), picked)
            origins = origins[:, picked]
        return MoveResult(particles), origins, float(log_evidence)


def traced(origins: AnyArray, ancestors: IntArray) -> AnyArray:
    """Return which particle (K + 1, N), LOOKED_BACK rows at most, each one comes from, one frame before it, two, and so
    on, after origins (K, N) of particles whose children have ancestors (N,) among them."""
    kept = origins[: LOOKED_BACK - 1]
    now = np.empty((len(kept) + 1, len(ancestors)), dtype=np.int32)
    now[0] = ancestors
    np.take(kept, ancestors, axis=1, out=now[1:], mode="clip")  # else by way of a copy
    return now


def start_around(prior: Prior, poses: FloatArray, n_particles: int, rng: np.random.Generator) -> FloatArray:
    """Draw states (N, D), as evenly as possible around the poses (n, P)."""
    shares = np.bincount(np.arange(n_particles) % len(poses), minlength=len(poses))
    return np.concatenate([prior.sample_initial(pose, int(n), rng) for pose, n in zip(poses, shares, strict=True) if n])


def _particle_step(frame: Frame, space: StateSpace, moved: MoveResult, log_evidence: float, clock: Stopwatch) -> Step:
    """Sum up one frame's particles, with the expected pose and that of the best particle."""
    particles = moved.particles
    best = int(np.argmax(particles.log_weights)) if moved.best is None else moved.best
    poses = nearest_turn(particles.poses, particles.poses[best])  # else the mean of two headings may be neither
    # not a BLAS product, whose order of addition depends on the number of threads
    expected = np.einsum("n,np->p", particles.weights, poses)
    clock.lap("summary")
    return Step(
        frame=frame, space=space, particles=particles.state, poses=poses, log_weights=particles.log_weights,
        ancestors=particles.ancestors, expected_pose=expected, map_pose=poses[best],
        ess=particles.ess, log_evidence=log_evidence,
        diagnostics=moved.diagnostics, warnings=moved.warnings, evaluations=moved.evaluations, timing_s=clock.laps,
    )  # fmt: skip
