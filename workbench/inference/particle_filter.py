"""The particle filter: sequential importance resampling (paper A, section 4.1; Gordon, Salmond & Smith 1993)."""

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, replace
from time import perf_counter

import numpy as np

from workbench.arrays import FloatArray, IntArray
from workbench.datasets.frame import Frame
from workbench.errors import InputError
from workbench.inference.resampling import RESAMPLING
from workbench.inference.step import Step
from workbench.inference.weights import logsumexp
from workbench.likelihoods.likelihood import Likelihood
from workbench.priors.state import Prior, propose


class DegenerateWeights(RuntimeError):  # noqa: N818 - the field's own term
    """No particle explains a frame, and the run was told to end there."""


@dataclass(frozen=True, eq=False)
class Particles:
    """N weighted states (N, D), their poses (N, P), normalised log weights (N,), and each one's parent (N,)."""

    state: FloatArray
    poses: FloatArray
    log_weights: FloatArray
    ancestors: IntArray


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
        """One step per frame; the first frame gives the start distribution around the pose `start` (P,), unweighted.

        rng_streams: generators named "start", "resampling" and "prior". Raises DegenerateWeights as configured.
        """
        previous: Frame | None = None
        log_evidence = 0.0
        for frame in frames:
            clock = _Stopwatch()
            if previous is None:
                state = self.prior.start(start, self.n_particles, rng_streams["start"])
                even = np.full(self.n_particles, -np.log(self.n_particles))
                particles = Particles(state, self.prior.pose(state), even, np.arange(self.n_particles))
                warnings: tuple[str, ...] = ()
                clock.lap("prior")
            else:
                particles, gained, warnings = self._advance(particles, previous, frame, rng_streams, clock)
                log_evidence += gained
            step = _step(frame, self.prior, particles, log_evidence, warnings, clock)
            yield replace(step, evaluations=0.0 if previous is None else float(self.n_particles))
            previous = frame

    def _advance(
        self,
        parents: Particles,
        previous: Frame,
        frame: Frame,
        rng_streams: Mapping[str, np.random.Generator],
        clock: "_Stopwatch",
    ) -> tuple[Particles, float, tuple[str, ...]]:
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
        log_weights, gained, warnings = self._weigh(frame, log_weights, correction, log_prob)
        return Particles(state, poses, log_weights, ancestors), gained, warnings + self.likelihood.warnings()

    def _weigh(
        self, frame: Frame, log_weights: FloatArray, correction: FloatArray, log_prob: FloatArray
    ) -> tuple[FloatArray, float, tuple[str, ...]]:
        """Normalised log weights, log p(frame | frames before), and what went wrong.

        correction: (N,) log weights of the prior's proposal.
        """
        undefined = np.isnan(log_prob) | (log_prob == np.inf)
        warnings: tuple[str, ...] = ()
        if undefined.any():
            warnings = (f"frame {frame.index}: the likelihood of {undefined.sum()} particles is undefined; dropped",)
            log_prob = np.where(undefined, -np.inf, log_prob)
        weighted = log_weights + correction + log_prob
        gained = float(logsumexp(weighted))
        if np.isfinite(gained):
            return weighted - gained, gained, warnings
        sentence = f"frame {frame.index}: no particle explains the image, every weight is zero"
        if self.on_degenerate == "stop":
            raise DegenerateWeights(sentence)
        return log_weights, 0.0, (*warnings, f"{sentence}; kept the prior's prediction, evidence not counted")


def effective_sample_size(log_weights: FloatArray) -> float:
    """1 / Σ w² of normalised log weights (N,) (Kong, Liu & Wong 1994)."""
    return float(np.exp(-logsumexp(2.0 * log_weights)))


def _step(
    frame: Frame,
    prior: Prior,
    particles: Particles,
    log_evidence: float,
    warnings: tuple[str, ...],
    clock: "_Stopwatch",
) -> Step:
    weights = np.exp(particles.log_weights)
    # not a BLAS product, whose order of addition depends on the number of threads
    expected = np.einsum("n,np->p", weights, particles.poses)
    clock.lap("summary")
    return Step(
        frame=frame,
        space=prior.space,
        particles=particles.state,
        poses=particles.poses,
        log_weights=particles.log_weights,
        ancestors=particles.ancestors,
        expected_pose=expected,
        map_pose=particles.poses[int(np.argmax(particles.log_weights))],
        ess=effective_sample_size(particles.log_weights),
        log_evidence=log_evidence,
        warnings=warnings,
        timing_s=clock.laps,
    )


class _Stopwatch:
    """Seconds since the last lap, by stage."""

    def __init__(self) -> None:
        self.laps: dict[str, float] = {}
        self._last = perf_counter()

    def lap(self, stage: str) -> None:
        now = perf_counter()
        self.laps[stage] = self.laps.get(stage, 0.0) + now - self._last
        self._last = now
