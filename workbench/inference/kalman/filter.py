"""The iterated extended Kalman filter (Bell & Cathey 1993) and the smoother of Rauch, Tung & Striebel (1965), for
likelihoods that are only known by their values."""

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import KW_ONLY, dataclass, replace
from functools import cached_property
from typing import Any, ClassVar

import numpy as np

from workbench.arrays import FloatArray, IntArray
from workbench.body.limbs import Body
from workbench.core.checks import UNIT, at_least, check
from workbench.core.frame import Frame
from workbench.core.likelihood import Likelihood, Look
from workbench.core.prior import Gaussian, Prior
from workbench.core.state_space import StateSpace
from workbench.core.step import Step
from workbench.core.traits import GAUSSIAN, START, Traits, offering
from workbench.errors import InputError
from workbench.inference.kalman.peak import Peak, find_peak
from workbench.inference.particles.target import Stopwatch
from workbench.inference.particles.weights import even_log_weights

BLOCKS = (
    ("root", "left_hip", "left_knee", "right_hip", "right_knee", "neck"), ("root",), ("left_hip", "left_knee"),
    ("right_hip", "right_knee"), ("left_shoulder", "left_elbow"), ("right_shoulder", "right_elbow"), ("root", "neck"),
)  # fmt: skip
"""What parameters that are guessed together begin with, in turn."""
FARTHER = 3.0
_LEAP = 1e-5
"""Over which the prior's mean is differentiated, m, rad and their speeds."""


@dataclass(frozen=True, eq=False)
class Belief:
    """N(mean (D,), covariance (D, D)) of the state in one frame, and what was believed before the frame was seen, with
    the derivatives (D, D) of that by the state before."""

    mean: FloatArray
    covariance: FloatArray
    predicted: FloatArray
    predicted_covariance: FloatArray
    transition: FloatArray


@dataclass(frozen=True, eq=False)
class Kalman:
    """Represent each frame's posterior by a Gaussian about its peak, and tell it as draws.

    The prior leads the Gaussian of the frame before on to N(m, P), by its mean's derivatives and its noise. The frame's
    peak is then looked for by Newton steps on log N(pose; m, P) + log p(frame | pose) (`peak.find_peak`), from the best
    of m and `guesses` changes of one limb after the other, and P is narrowed by the likelihood's curvature there.
    Unlike particles this has no need to be lucky in 25 numbers at once, so that likelihoods may be sharp.

    second_pass: when all frames are seen, go back over them, so that each is told what followed; else every frame is
    told as soon as it is seen. steps: of Newton. flatten: power of the likelihood that narrows P: below 1, bands are
    wider, and the next frame's search goes farther. n_particles: draws that stand for the Gaussian, with even weights.
    Raises InputError for a prior without Gaussian noise and numbers out of range.
    """

    traits: ClassVar[Traits] = offering(dataset=START, prior=GAUSSIAN, likelihood=())

    prior: Prior
    likelihood: Likelihood
    body: Body
    _: KW_ONLY
    n_particles: int = 500
    steps: int = 3
    guesses: int = 40
    flatten: float = 0.05
    second_pass: bool = True

    finds_start: ClassVar[bool] = False

    def __post_init__(self) -> None:
        check("inference", self, n_particles=at_least(2), steps=at_least(1), guesses=at_least(0), flatten=UNIT)

    @property
    def space(self) -> StateSpace:
        """Return the prior's."""
        return self.prior.space

    def run(
        self, frames: Iterable[Frame], start: FloatArray | None, rng_streams: Mapping[str, np.random.Generator]
    ) -> Iterator[Step]:
        """Yield one step per frame, after the last frame where there is a second pass; the first gives the start
        distribution around the pose `start` (P,) or, of several (n, P), around the first. Raises InputError without."""
        if start is None:
            raise InputError("inference: a Kalman filter needs a pose to start from, found none")
        model = gaussian_of(self.prior)
        filtered = self._filtered(model, frames, np.atleast_2d(start)[0], rng_streams["resampling"])
        if not self.second_pass:
            for frame, belief, extra in filtered:
                yield self._step(frame, belief, rng_streams["prior"], extra)
            return
        seen = list(filtered)
        clock = Stopwatch()
        beliefs = smoothed([belief for _, belief, _ in seen])
        clock.lap("second pass")
        for (frame, _, extra), belief in zip(seen, beliefs, strict=True):
            yield self._step(frame, belief, rng_streams["prior"], extra)

    def _filtered(
        self, model: Gaussian, frames: Iterable[Frame], start: FloatArray, rng: np.random.Generator
    ) -> Iterator[tuple[Frame, Belief, dict[str, Any]]]:
        likelihood, previous, log_evidence = self.likelihood, None, 0.0
        mean, covariance = model.start_moments(start)
        belief = Belief(mean, covariance, mean, covariance, np.eye(len(mean)))
        for frame in frames:
            clock, evaluations = Stopwatch(), 0.0
            look = likelihood.look(previous, frame)
            if previous is not None:
                before = self.prior.pose(belief.mean[None])
                predicted = predict(model, belief, frame.time_s - previous.time_s)
                clock.lap("prior")
                belief, peak = self._updated(predicted, look, before, rng)
                log_evidence, evaluations = log_evidence + peak.log_evidence, float(peak.evaluations)
            likelihood = look.remember(self.prior.pose(belief.mean[None])[0])
            clock.lap("likelihood")
            yield frame, belief, {
                "log_evidence": log_evidence, "timing_s": clock.laps, "warnings": tuple(look.notes),
                "diagnostics": look.diagnostics, "evaluations": evaluations,
            }  # fmt: skip
            previous = frame

    def _updated(self, belief: Belief, look: Look, before: FloatArray, rng: np.random.Generator) -> tuple[Belief, Peak]:
        """Take in what a frame shows; the person was in the pose `before` (1, P)."""
        n = before.shape[1]
        mean, covariance = belief.mean[:n], belief.covariance[:n, :n]
        guesses = [self._changes(covariance, own, rng) for own in self._blocks]

        def log_likelihood(poses: FloatArray) -> FloatArray:
            return look.evaluate(np.repeat(before, len(poses), axis=0), poses).log_prob

        limits = self.body.skeleton.limits
        peak = find_peak(
            log_likelihood, mean, covariance, limits, guesses=guesses, steps=self.steps, flatten=self.flatten
        )
        gain = np.linalg.solve(covariance + 1e-12 * np.eye(n), belief.covariance[:n]).T  # of all columns by the pose's
        updated = belief.covariance - gain @ (covariance - peak.covariance) @ gain.T
        told = replace(belief, mean=belief.mean + gain @ (peak.pose - mean), covariance=0.5 * (updated + updated.T))
        return told, peak

    @cached_property
    def _blocks(self) -> list[IntArray]:
        """The columns of poses that are guessed together, of BLOCKS."""
        names = self.body.skeleton.dof_names
        found = [[k for k, name in enumerate(names) if name.startswith(words)] for words in BLOCKS]
        return [np.array(own, dtype=np.int64) for own in found if own]

    def _changes(self, covariance: FloatArray, own: IntArray, rng: np.random.Generator) -> FloatArray:
        """Draw changes (G, P) of some columns, from the prediction's covariance and, half of them, FARTHER."""
        root = np.linalg.cholesky(covariance[np.ix_(own, own)] + 1e-12 * np.eye(len(own)))
        changes = np.zeros((self.guesses, len(covariance)))
        changes[:, own] = rng.standard_normal((self.guesses, len(own))) @ root.T
        changes[::2] *= FARTHER
        return changes

    def _step(self, frame: Frame, belief: Belief, rng: np.random.Generator, extra: Mapping[str, Any]) -> Step:
        values, vectors = np.linalg.eigh(belief.covariance)
        half = rng.standard_normal((self.n_particles // 2, len(values)))  # in pairs, whose mean is the Gaussian's
        white = np.concatenate([half, -half, np.zeros((self.n_particles % 2, len(values)))])
        state = belief.mean + (white * np.sqrt(np.maximum(values, 0.0))) @ vectors.T
        nearest = int(np.argmin((white**2).sum(axis=1)))
        poses, expected = self.prior.pose(state), self.prior.pose(belief.mean[None])[0]
        return Step(
            frame=frame, space=self.space, particles=state, poses=poses,
            log_weights=even_log_weights(self.n_particles), ancestors=np.arange(self.n_particles),
            expected_pose=expected, map_pose=poses[nearest], ess=float(self.n_particles), **extra,
        )  # fmt: skip


def gaussian_of(prior: Prior) -> Gaussian:
    """Return the prior's density; raises InputError where its noise is not Gaussian."""
    density = prior.powers.density
    if not isinstance(density, Gaussian):
        raise InputError(f"inference: a Kalman filter needs a prior with Gaussian noise, such as linear, found {prior}")
    return density


def predict(model: Gaussian, belief: Belief, dt_s: float) -> Belief:
    """Lead a belief on by the prior's mean, its derivatives and its noise."""
    d = len(belief.mean)
    around = belief.mean + _LEAP * np.concatenate([np.zeros((1, d)), np.eye(d), -np.eye(d)])
    led = model.mean(around, dt_s)
    transition = (led[1 : d + 1] - led[d + 1 :]).T / (2.0 * _LEAP)
    covariance = transition @ belief.covariance @ transition.T
    covariance += model.noise_covariance(belief.mean, dt_s)
    return Belief(led[0], covariance, led[0], covariance, transition)


def smoothed(beliefs: list[Belief]) -> list[Belief]:
    """Go back over filtered beliefs: m_t += G (m_t+1 − m⁻_t+1), P_t += G (P_t+1 − P⁻_t+1) Gᵀ, G = P_t Fᵀ P⁻_t+1⁻¹,
    the minus marking what was predicted (Rauch, Tung & Striebel 1965)."""
    told = beliefs[-1:]
    for belief, following in zip(beliefs[-2::-1], beliefs[:0:-1], strict=True):
        across = following.transition @ belief.covariance
        gain = np.linalg.lstsq(following.predicted_covariance, across, rcond=1e-12)[0].T
        later = told[-1]
        mean = belief.mean + gain @ (later.mean - following.predicted)
        covariance = belief.covariance + gain @ (later.covariance - following.predicted_covariance) @ gain.T
        told.append(replace(belief, mean=mean, covariance=0.5 * (covariance + covariance.T)))
    return told[::-1]
