"""The particle filter: sequential importance resampling (Doucet, de Freitas & Gordon 2001) with any move."""

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import KW_ONLY, dataclass, replace
from typing import Any, ClassVar, Literal, Self

import numpy as np

from workbench.body.angles import unwrap_near
from workbench.core.capabilities import START, Traits, combined_requirements, component_traits
from workbench.core.checks import at_least, check, one_of
from workbench.core.frame import Frame
from workbench.core.likelihood import Likelihood
from workbench.core.prior import Prior
from workbench.core.state_space import StateSpace
from workbench.core.step import Step
from workbench.inference.smc.bootstrap import Bootstrap
from workbench.inference.smc.move import Move, Streams
from workbench.inference.smc.target import MoveResult, Particles, Stopwatch, Target, Workspace
from workbench.inference.smc.weights import DegenerateWeights as DegenerateWeights
from workbench.inference.smc.weights import uniform_log_weights
from workbench.utils.arrays import AnyArray, FloatArray, IntArray
from workbench.utils.errors import InputError

ANCESTRY_FRAMES = 10
"""Lag, frames, of the diagnostic `unique_ancestors_lag10`: particles of equal weight may have a single common
ancestor."""


@dataclass(frozen=True, eq=False)
class ParticleFilter:
    """Represent each frame's posterior by N weighted particles, which a move propagates from the previous frame.

    algorithm: the move, which chooses parents, samples states and weights them. n_particles: N. on_degenerate: action
    if every weight of a frame is zero or undefined: "recover" uses the prior's prediction with equal weights, or those
    of the previous frame, and warns, "stop" raises DegenerateWeights. Raises InputError for other values and a prior
    that does not meet the move's requirements.
    """

    @staticmethod
    def traits(keys: Mapping[str, Any]) -> Traits:
        """Declare the requirement of a prior, a likelihood and an initial pose, and those of the move."""
        basic = component_traits(dataset=START, prior=(), likelihood=())
        return Traits(requires=combined_requirements({"filter": basic, "algorithm": keys["algorithm"] or Traits()}))

    prior: Prior
    likelihood: Likelihood
    _: KW_ONLY
    algorithm: Move = Bootstrap()  # noqa: RUF009 - frozen
    n_particles: int = 5000
    on_degenerate: str = "recover"

    kind: ClassVar[Literal["filtered"]] = "filtered"
    finds_start: ClassVar[bool] = False

    def __post_init__(self) -> None:
        check("inference", self, n_particles=at_least(1), on_degenerate=one_of("recover", "stop"))
        self.algorithm.check(self.prior, self.n_particles)

    @property
    def space(self) -> StateSpace:
        """Return the prior's state space."""
        return self.prior.space

    def rebuilt(self, **components: Any) -> Self:
        """Return it with other components, such as the prior, the algorithm or n_particles."""
        return replace(self, **components)

    def run(self, frames: Iterable[Frame], start: FloatArray | None, rng_streams: Streams) -> Iterator[Step]:
        """Yield one step per frame, of which the first represents the initial distribution.

        Parameters
        ----------
        frames : of the sequence.
        start : (P,) or (n, P), initial poses, of equal weight.
        rng_streams : generators named "start", "resampling" and "prior".

        Raises
        ------
        InputError : there is no start.
        DegenerateWeights : as configured.
        """
        likelihood, log_evidence, workspace = self.likelihood, 0.0, Workspace()
        origins: AnyArray = np.empty((0, self.n_particles), dtype=np.int32)
        previous: Frame | None = None
        for frame in frames:
            clock = Stopwatch()
            frame_likelihood = likelihood.prepare(previous, frame)
            clock.lap("likelihood")
            if previous is None:
                result = self._initial_particles(start, rng_streams["start"])
                clock.lap("prior")
            else:
                stop = self.on_degenerate == "stop"
                result = self.algorithm(
                    Target(self.prior, frame_likelihood, result.particles, previous, frame, clock, stop, workspace),
                    rng_streams,
                )
            origins = trace_ancestry(origins, result.particles.ancestors)
            distinct = {"unique_ancestors_lag10": float(np.count_nonzero(np.bincount(origins[-1])))}
            diagnostics = {**frame_likelihood.diagnostics, **result.diagnostics, **distinct}
            warnings = (*frame_likelihood.notes, *result.warnings)
            result = replace(result, warnings=warnings, diagnostics=diagnostics)
            log_evidence += result.log_gain
            step = _particle_step(frame, self.space, result, log_evidence, clock)
            likelihood = frame_likelihood.update(step.expected_pose)
            clock.lap("likelihood")
            yield step
            previous = frame

    def _initial_particles(self, poses: FloatArray | None, rng: np.random.Generator) -> MoveResult:
        """Return equally weighted particles at poses (P,) or (n, P).

        They are not local variables of `run`, which would retain them until the last frame.
        """
        if poses is None:
            raise InputError("inference: a particle filter needs a pose to start from, found none")
        state = sample_start(self.prior, np.atleast_2d(poses), self.n_particles, rng)
        log_weights, ancestors = uniform_log_weights(self.n_particles), np.arange(self.n_particles)
        particles = Particles(state, self.prior.pose(state), log_weights, ancestors)
        diagnostics, warnings = self.algorithm.initial_diagnostics(self.n_particles)
        return MoveResult(particles, diagnostics=diagnostics, warnings=warnings)


def trace_ancestry(origins: AnyArray, ancestors: IntArray) -> AnyArray:
    """Return each particle's ancestors (K + 1, N) one frame earlier, two frames earlier, and so on.

    Parameters
    ----------
    origins : (K, N), ancestors of the parents; at most ANCESTRY_FRAMES − 1 rows are used.
    ancestors : (N,), indices of the parents.
    """
    earlier = origins[: ANCESTRY_FRAMES - 1]
    traced = np.empty((len(earlier) + 1, len(ancestors)), dtype=np.int32)
    traced[0] = ancestors
    np.take(earlier, ancestors, axis=1, out=traced[1:], mode="clip")  # other modes copy first
    return traced


def sample_start(prior: Prior, poses: FloatArray, n_particles: int, rng: np.random.Generator) -> FloatArray:
    """Sample states (N, D) from the initial distributions at poses (n, P), in numbers as equal as possible."""
    counts = np.bincount(np.arange(n_particles) % len(poses), minlength=len(poses))
    return np.concatenate([prior.sample_initial(pose, int(n), rng) for pose, n in zip(poses, counts, strict=True) if n])


def _particle_step(frame: Frame, space: StateSpace, result: MoveResult, log_evidence: float, clock: Stopwatch) -> Step:
    """Return the step of one frame's particles, with the expected pose and that of the best particle."""
    particles = result.particles
    best = int(np.argmax(particles.log_weights)) if result.best is None else result.best
    poses = unwrap_near(particles.poses, particles.poses[best])  # so that angles can be averaged
    # not a BLAS product, whose order of addition depends on the number of threads
    expected = np.einsum("n,np->p", particles.weights, poses)
    clock.lap("summary")
    return Step(
        frame=frame, space=space, particles=particles.state, poses=poses, log_weights=particles.log_weights,
        ancestors=particles.ancestors, expected_pose=expected, map_pose=poses[best],
        ess=particles.ess, log_evidence=log_evidence,
        diagnostics=result.diagnostics, warnings=result.warnings, evaluations=result.evaluations, timing_s=clock.laps,
    )  # fmt: skip
