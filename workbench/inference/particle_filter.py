"""The particle filter: sequential importance resampling (paper A, section 4.1; Gordon, Salmond & Smith 1993)."""

from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass, field, replace
from time import perf_counter
from types import MappingProxyType

import numpy as np

from workbench.arrays import FloatArray, IntArray
from workbench.datasets.frame import Frame
from workbench.errors import InputError
from workbench.inference.resampling import RESAMPLING
from workbench.inference.step import Step
from workbench.inference.weights import logsumexp
from workbench.likelihoods.likelihood import Likelihood, diagnostics, remember
from workbench.priors.state import Prior, StateSpace, propose


class DegenerateWeights(RuntimeError):  # noqa: N818 - the field's own term
    """No particle explains a frame, and the run was told to end there."""


@dataclass(frozen=True, eq=False)
class Particles:
    """N weighted states (N, D), their poses (N, P), normalised log weights (N,), and each one's parent (N,)."""

    state: FloatArray
    poses: FloatArray
    log_weights: FloatArray
    ancestors: IntArray


@dataclass(frozen=True, eq=False)
class Advanced:
    """What one more frame makes of the particles.

    log_gain: log p(frame | frames before). evaluations: how often the likelihood was evaluated, for one pose each.
    best: index of the particle whose pose is the step's `map_pose`; None: the heaviest.
    """

    particles: Particles
    log_gain: float
    evaluations: float
    warnings: tuple[str, ...] = ()
    diagnostics: Mapping[str, float] = field(default_factory=dict)
    best: int | None = None


Advance = Callable[[Particles, Frame, Frame, Mapping[str, np.random.Generator], "Stopwatch"], Advanced]
"""From the particles of the previous frame to those of this one: (parents, previous, frame, streams, clock)."""


def filtered(
    prior: Prior,
    likelihood: Likelihood,
    n_particles: int,
    advance: Advance,
    frames: Iterable[Frame],
    start: FloatArray,
    rng_streams: Mapping[str, np.random.Generator],
    first: Mapping[str, float] = MappingProxyType({}),
) -> Iterator[Step]:
    """One step per frame; the first frame gives the start distribution, unweighted, around the pose `start` (P,), or
    in even parts around each of the poses (n, P).

    A likelihood that remembers is told of every frame what was expected in it.

    rng_streams: generators named "start" and those that `advance` draws from, which makes all steps but the first.
    first: diagnostics of the first step; a recording arranges its views by what that one has.
    """
    previous: Frame | None = None
    log_evidence = 0.0
    for frame in frames:
        clock = Stopwatch()
        if previous is None:
            advanced = _at_first(prior, np.atleast_2d(start), n_particles, rng_streams["start"], first)
            clock.lap("prior")
        else:
            advanced = advance(advanced.particles, previous, frame, rng_streams, clock)
        log_evidence += advanced.log_gain
        step = particle_step(frame, prior.space, advanced, log_evidence, clock)
        remember(likelihood, frame, step.expected_pose, first=previous is None)
        clock.lap("likelihood")
        yield replace(step, diagnostics={**diagnostics(likelihood), **step.diagnostics}, timing_s=clock.laps)
        previous = frame


def started_at(prior: Prior, poses: FloatArray, n_particles: int, rng: np.random.Generator) -> FloatArray:
    """States (N, D), as evenly as possible around the poses (n, P)."""
    shares = np.bincount(np.arange(n_particles) % len(poses), minlength=len(poses))
    return np.concatenate([prior.start(pose, int(n), rng) for pose, n in zip(poses, shares, strict=True) if n])


def _at_first(
    prior: Prior, poses: FloatArray, n_particles: int, rng: np.random.Generator, diagnostics: Mapping[str, float]
) -> Advanced:
    """Even particles around the poses (n, P). Names in `filtered` would hold them until the last frame."""
    state, even = started_at(prior, poses, n_particles, rng), np.full(n_particles, -np.log(n_particles))
    particles = Particles(state, prior.pose(state), even, np.arange(n_particles))
    return Advanced(particles, 0.0, 0.0, diagnostics=diagnostics)


class ParticleFilter:
    """Draw from the posterior at t−1, propagate by the prior, weight by the likelihood, normalise.

    Where the prior draws from a proposal of its own (`Proposing`), its correction enters the weights.
    n_particles: N. resampling: systematic, multinomial or residual. ess_threshold: resample when the effective
    sample size falls to this fraction of N or below; 1 resamples before every frame, as the paper does.
    on_degenerate: what to do when every weight of a frame is zero or undefined: "recover" keeps the prior's
    prediction with the weights of the frame before and says so, "stop" raises DegenerateWeights.
    """

    def __init__(
        self,
        prior: Prior,
        likelihood: Likelihood,
        *,
        n_particles: int = 5000,
        resampling: str = "systematic",
        ess_threshold: float = 1.0,
        on_degenerate: str = "recover",
    ) -> None:
        if n_particles < 1:
            raise InputError(f"inference: n_particles must be at least 1, found {n_particles}")
        if resampling not in RESAMPLING:
            raise InputError(f"inference: resampling must be one of {', '.join(RESAMPLING)}, found {resampling!r}")
        if not 0.0 <= ess_threshold <= 1.0:
            raise InputError(f"inference: ess_threshold must lie between 0 and 1, found {ess_threshold}")
        if on_degenerate not in ("recover", "stop"):
            raise InputError(f"inference: on_degenerate must be 'recover' or 'stop', found {on_degenerate!r}")
        self.prior = prior
        self.space = prior.space
        self.likelihood = likelihood
        self.n_particles = n_particles
        self.resample = RESAMPLING[resampling]
        self.ess_threshold = ess_threshold
        self.on_degenerate = on_degenerate

    def run(
        self, frames: Iterable[Frame], start: FloatArray, rng_streams: Mapping[str, np.random.Generator]
    ) -> Iterator[Step]:
        """One step per frame; the first frame gives the start distribution around the pose `start` (P,), unweighted, or
        the even mixture of those around several, (n, P).

        rng_streams: generators named "start", "resampling" and "prior". Raises DegenerateWeights as configured.
        """
        return filtered(self.prior, self.likelihood, self.n_particles, self.advance, frames, start, rng_streams)

    def advance(
        self,
        parents: Particles,
        previous: Frame,
        frame: Frame,
        rng_streams: Mapping[str, np.random.Generator],
        clock: "Stopwatch",
    ) -> Advanced:
        """Resample, propagate, weigh."""
        log_weights, ancestors = parents.log_weights, np.arange(self.n_particles)
        if effective_sample_size(log_weights) <= self.ess_threshold * self.n_particles:
            ancestors = self.resample(np.exp(log_weights), rng_streams["resampling"])
            log_weights = np.full(self.n_particles, -np.log(self.n_particles))
        clock.lap("resampling")
        dt_s = frame.time_s - previous.time_s
        state, correction = propose(self.prior, parents.state.take(ancestors, axis=0), dt_s, rng_streams["prior"])
        poses = self.prior.pose(state)
        clock.lap("prior")
        log_prob = self.likelihood.log_prob(previous, frame, parents.poses.take(ancestors, axis=0), poses)
        clock.lap("likelihood")
        stop = self.on_degenerate == "stop"
        log_weights, gained, warnings = weigh(frame, log_weights, log_prob, correction, stop=stop)
        particles = Particles(state, poses, log_weights, ancestors)
        return Advanced(particles, gained, float(self.n_particles), warnings + self.likelihood.warnings())


def weigh(
    frame: Frame,
    log_weights: FloatArray,
    log_prob: FloatArray,
    correction: FloatArray | float = 0.0,
    *,
    stop: bool = False,
) -> tuple[FloatArray, float, tuple[str, ...]]:
    """Normalised log weights, log p(frame | frames before), and what went wrong.

    correction: (N,) log weights of the prior's proposal. stop: raise DegenerateWeights where every weight is zero.
    """
    log_prob, warnings = defined(frame, log_prob)
    weighted = log_weights + correction + log_prob
    gained = float(logsumexp(weighted))
    if np.isfinite(gained):
        return weighted - gained, gained, warnings
    sentence = f"frame {frame.index}: no particle explains the image, every weight is zero"
    if stop:
        raise DegenerateWeights(sentence)
    return log_weights, 0.0, (*warnings, f"{sentence}; kept the prior's prediction, evidence not counted")


def defined(frame: Frame, log_prob: FloatArray) -> tuple[FloatArray, tuple[str, ...]]:
    """Log likelihoods (N,) with −∞ for those that are undefined, and a sentence that says so."""
    undefined = np.isnan(log_prob) | (log_prob == np.inf)
    if not undefined.any():
        return log_prob, ()
    sentence = f"frame {frame.index}: the likelihood of {undefined.sum()} particles is undefined; dropped"
    return np.where(undefined, -np.inf, log_prob), (sentence,)


def effective_sample_size(log_weights: FloatArray) -> float:
    """1 / Σ w² of normalised log weights (N,) (Kong, Liu & Wong 1994)."""
    return float(np.exp(-logsumexp(2.0 * log_weights)))


def particle_step(frame: Frame, space: StateSpace, advanced: Advanced, log_evidence: float, clock: "Stopwatch") -> Step:
    """The step of one frame's particles, with the expected pose and that of the best particle."""
    particles = advanced.particles
    weights = np.exp(particles.log_weights)
    # not a BLAS product, whose order of addition depends on the number of threads
    expected = np.einsum("n,np->p", weights, particles.poses)
    best = int(np.argmax(particles.log_weights)) if advanced.best is None else advanced.best
    clock.lap("summary")
    return Step(
        frame=frame,
        space=space,
        particles=particles.state,
        poses=particles.poses,
        log_weights=particles.log_weights,
        ancestors=particles.ancestors,
        expected_pose=expected,
        map_pose=particles.poses[best],
        ess=effective_sample_size(particles.log_weights),
        log_evidence=log_evidence,
        diagnostics=advanced.diagnostics,
        warnings=advanced.warnings,
        evaluations=advanced.evaluations,
        timing_s=clock.laps,
    )


class Stopwatch:
    """Seconds since the last lap, by stage."""

    def __init__(self) -> None:
        self.laps: dict[str, float] = {}
        self._last = perf_counter()

    def lap(self, stage: str) -> None:
        now = perf_counter()
        self.laps[stage] = self.laps.get(stage, 0.0) + now - self._last
        self._last = now
