"""Smoothing: estimates of each frame that use later frames too (Godsill, Doucet & West 2004)."""

from collections import deque
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import KW_ONLY, dataclass, replace
from itertools import accumulate
from typing import Any, ClassVar

import numpy as np
from tqdm import tqdm

from workbench.body.angles import unwrap_near
from workbench.core.capabilities import DENSITY, Traits, combined_requirements, component_traits
from workbench.core.checks import at_least, check
from workbench.core.frame import Frame, repeatable
from workbench.core.likelihood import FrameLikelihood
from workbench.core.step import Step
from workbench.inference.smc.move import Kind, Move, Streams, WrappedMove, Wrapper
from workbench.inference.smc.target import MoveResult, Target, density_of
from workbench.inference.smc.weights import drop_undefined, effective_number, systematic, uniform_log_weights
from workbench.utils.arrays import FloatArray, IntArray
from workbench.utils.timing import working_s

BLOCK = 2_000_000
"""Maximum size of the arrays in which trajectories are compared with particles."""


@dataclass(frozen=True, eq=False)
class FixedLag(Wrapper):
    """A particle filter reported `lag` frames late: p(state_t | frames up to t + lag) by ancestry (Kitagawa 1996).

    It costs nothing, supports every prior, and streams; but every resampling reduces the number of distinct ancestors.
    A frame is therefore reported given the latest frame, at most t + lag, whose particles have an effective number of
    ancestors in it of at least `min_effective_ancestors`, 1 / Σ_a (Σ_i w_i)² with i over the particles of ancestor a;
    at worst given itself. (For n < 20, the 90 % credible interval of n independent samples from the posterior contains
    the ground truth in only (n − 1) / (n + 1) of all cases.) The diagnostic `lag` is the number of later frames used.

    filter: with any algorithm, reinitializing or not. lag: frames, at least 1. Raises InputError for numbers out of
    range.
    """

    _: KW_ONLY
    lag: int = 5
    min_effective_ancestors: int = 50

    wraps: ClassVar[tuple[Kind, ...]] = ("filtered", "reinitialized")
    kind: ClassVar[Kind] = "smoothed"

    def __post_init__(self) -> None:
        super().__post_init__()
        check("inference", self, lag=at_least(1), min_effective_ancestors=at_least(1))

    def run(self, frames: Iterable[Frame], start: FloatArray | None, rng_streams: Streams) -> Iterator[Step]:
        """Yield one step per frame, each after `lag` later frames; log_evidence is the filter's for that frame.

        rng_streams: as for the filter. ess and the diagnostic `unique_particles` count ancestors.
        """
        window, ahead = deque[Step](), 0
        for step in self.filter.run(frames, start, rng_streams):
            window.append(step)
            if len(window) > self.lag:
                smoothed, ahead = self._smooth_first(window, ahead)
                yield smoothed
                window.popleft()
        while window:  # the last frames have fewer later ones
            smoothed, ahead = self._smooth_first(window, ahead)
            yield smoothed
            window.popleft()

    def _smooth_first(self, window: Iterable[Step], previous_lag: int) -> tuple[Step, int]:
        """Return the window's first step with the ancestors of a later step's particles, and the lag of that step.

        previous_lag: of the previous frame, whose particles the result's `ancestors` index.
        """
        first, *later = window
        # for each step, the ancestors of its particles in the first step
        particles = np.arange(len(first.ancestors))
        lineages = list(accumulate(later, lambda lineage, step: lineage[step.ancestors], initial=particles))
        enough = [
            effective_number(lineage, step.log_weights) >= self.min_effective_ancestors
            for lineage, step in zip(lineages, (first, *later), strict=True)
        ]
        # not before the last result's frame: ancestors there are ancestors of those here, and not more
        lag = max([previous_lag - 1, 0, *np.flatnonzero(enough)])
        parents = particles
        for step in (first, *later)[previous_lag : lag + 1]:
            parents = parents[step.ancestors]
        weights = (first, *later)[lag].log_weights
        smoothed = _with_particles(first, lineages[lag], weights, parents, int(np.argmax(weights)))
        return replace(smoothed, diagnostics={**smoothed.diagnostics, "lag": float(lag)}), lag


@dataclass(frozen=True, eq=False)
class BackwardSimulation(Wrapper):
    """Sample trajectories from p(all states | all frames), backwards over a particle filter's particles.

    The last state of a trajectory is a particle of the last frame; then, backwards in time, particle i of frame t is
    sampled by

        w_t^i p(state_t+1 | state_t^i) p(frame_t+1 | pose_t+1, pose_t^i, frame_t, …)

    (Godsill, Doucet & West 2004, algorithm 1), where the state of frame t + 1 is the one just sampled. The last factor
    applies to likelihoods of the previous pose: instead of evaluating it for all particles and trajectories,
    `n_mcmc_steps` Metropolis–Hastings steps propose particles by the first two factors and accept them by the third,
    starting from the ancestor (Bunch & Godsill 2013, section 3). Without it every proposal is accepted, and one step is
    the algorithm itself. Each frame's likelihood, with its state, is stored until the trajectories are sampled.

    If a state has many columns with noise, hardly any particle except the ancestor leads to a given state, and all
    trajectories meet in a few particles. A frame in which the effective number n of distinct particles on them is below
    `min_effective_ancestors` is therefore reported as by the filter, with a warning, and new trajectories start there.
    The diagnostic `lag` is the number of later frames used. (There, `ancestors` connects one trajectory to another that
    does not continue it.) The mean of n samples errs by 1 / √n standard deviations, that of the filter by nearly one:
    a limit far above 5 replaces means that are more exact.

    filter: with any algorithm, for a prior with a density. n_paths: number of trajectories, which become the equally
    weighted particles of the steps; a step's `map_pose` is that of the trajectory with the highest density, excluding
    the initial distribution. Raises InputError for a prior without a density and numbers out of range.
    """

    @staticmethod
    def traits(keys: Mapping[str, Any]) -> Traits:
        """Declare the filter's requirements, and a density."""
        paths = component_traits(prior=DENSITY)
        return Traits(requires=combined_requirements({"filter": keys["filter"], "paths": paths}))

    _: KW_ONLY
    n_paths: int = 500
    n_mcmc_steps: int = 2
    min_effective_ancestors: int = 5

    kind: ClassVar[Kind] = "smoothed"

    def __post_init__(self) -> None:
        super().__post_init__()
        density_of(self.prior)
        check("inference", self, n_paths=at_least(1), n_mcmc_steps=at_least(1), min_effective_ancestors=at_least(1))

    def run(self, frames: Iterable[Frame], start: FloatArray | None, rng_streams: Streams) -> Iterator[Step]:
        """Yield one step per frame, all of them after the last frame is filtered and the trajectories are sampled.

        rng_streams: as for the filter, and "resampling" for the trajectories. log_evidence is the filter's for that
        frame; ess and the diagnostic `unique_particles` count the particles on the trajectories.
        """
        frame_likelihoods: list[FrameLikelihood] = []

        def record_likelihood(move: Move, target: Target, rng_streams: Streams) -> MoveResult:
            frame_likelihoods.append(target.frame_likelihood)
            return move(target, rng_streams)

        recording = self.filter.rebuilt(algorithm=WrappedMove(self.algorithm, record_likelihood))
        frames = repeatable(frames)
        forward = tqdm(recording.run(frames, start, rng_streams), "filter", unit="frame", disable=None, leave=False)
        steps = [replace(step, frame=step.frame.without_images) for step in forward]
        smoothed = reversed(list(self._backwards(steps, frame_likelihoods, rng_streams["resampling"])))
        for frame, step in zip(frames, smoothed, strict=True):
            yield replace(step, frame=frame)

    def _backwards(
        self, steps: list[Step], frame_likelihoods: list[FrameLikelihood], rng: np.random.Generator
    ) -> Iterator[Step]:
        """Yield the steps with the trajectories as particles, the last one first.

        frame_likelihoods: of all frames except the first.
        """
        uniform = uniform_log_weights(self.n_paths)
        score, segment, chosen = np.zeros(self.n_paths), list[tuple[Step, IntArray]](), np.zeros(0, dtype=np.int64)
        for t in tqdm(range(len(steps) - 1, -1, -1), desc="backwards", unit="frame", disable=None, leave=False):
            began = working_s()
            if segment:
                chosen, gain, step, later = self._step_back(steps[t], *segment[-1], frame_likelihoods[t], rng)
                score, segment[-1] = score + gain, (later, segment[-1][1])
            n_effective = effective_number(chosen, uniform) if segment else 0.0
            if n_effective < self.min_effective_ancestors:
                yield from self._smoothed_steps(segment, score)
                step, score = steps[t], np.zeros(self.n_paths)
                if segment:
                    few = f"frame {step.frame.index}: the trajectories meet in {n_effective:.1f} effective particles"
                    step, segment = replace(step, warnings=(*step.warnings, f"{few}; filtered, not smoothed")), []
                chosen = systematic(np.exp(step.log_weights), rng, self.n_paths)
            timing_s = {**step.timing_s, "smoothing": working_s() - began}
            segment.append((replace(step, timing_s=timing_s), chosen))
        yield from self._smoothed_steps(segment, score)

    def _smoothed_steps(self, segment: list[tuple[Step, IntArray]], score: FloatArray) -> Iterator[Step]:
        """Yield a segment's steps, the last one first, with the particles (M,) on the trajectories."""
        uniform, best = uniform_log_weights(self.n_paths), int(np.argmax(score))
        for lag, (step, chosen) in enumerate(segment):
            smoothed = _with_particles(step, chosen, uniform, np.arange(self.n_paths), best)
            yield replace(smoothed, diagnostics={"acceptance_rate": 1.0, **smoothed.diagnostics, "lag": float(lag)})

    def _step_back(
        self, step: Step, later: Step, chosen: IntArray, frame_likelihood: FrameLikelihood, rng: np.random.Generator
    ) -> tuple[IntArray, FloatArray, Step, Step]:
        """Extend the trajectories from the particles chosen (M,) of the later step to the step before it.

        Returns
        -------
        The particles (M,) of `step`, the log density (M,) of this part of the trajectories, and both steps, with the
        acceptance rate and the number of evaluations.
        """
        dt_s = later.frame.time_s - step.frame.time_s
        states, poses = later.particles[chosen], later.poses[chosen]
        current = later.ancestors[chosen]
        log_prob, more = _log_prob(frame_likelihood, step, later, current, poses)
        warnings = [*later.warnings, *more]
        acceptance_rate = 0.0
        for proposed in self._propose(step, states, dt_s, rng):
            proposed_log_prob, more = _log_prob(frame_likelihood, step, later, proposed, poses)
            warnings += more
            with np.errstate(invalid="ignore"):  # −∞ − (−∞) if neither is possible
                accept = np.log1p(-rng.random(self.n_paths)) < proposed_log_prob - log_prob
            current = np.where(accept, proposed, current)
            log_prob = np.where(accept, proposed_log_prob, log_prob)
            acceptance_rate += float(accept.mean()) / self.n_mcmc_steps
        gain = density_of(self.prior).log_transition(step.particles[current], states, dt_s) + log_prob
        evaluations = later.evaluations + float(self.n_paths * (1 + self.n_mcmc_steps))
        step = replace(step, diagnostics={**step.diagnostics, "acceptance_rate": acceptance_rate})
        later = replace(later, evaluations=evaluations, warnings=tuple(dict.fromkeys(warnings)))
        return current, gain, step, later

    def _propose(self, step: Step, states: FloatArray, dt_s: float, rng: np.random.Generator) -> IntArray:
        """Sample particles (n_mcmc_steps, M) of `step` by their weights and transition densities to states (M, D)."""
        uniforms = rng.random((self.n_mcmc_steps, len(states)))
        proposed = np.empty(uniforms.shape, dtype=np.int64)
        rows = max(1, BLOCK // step.particles.size)
        for first in range(0, len(states), rows):
            block = slice(first, first + rows)
            log_transition = density_of(self.prior).log_transition(step.particles[None], states[block, None], dt_s)
            log_odds = log_transition + step.log_weights
            edges = np.cumsum(np.exp(log_odds - log_odds.max(axis=1, keepdims=True)), axis=1)  # the ancestor's: finite
            for k in range(self.n_mcmc_steps):
                proposed[k, block] = (edges <= uniforms[k, block, None] * edges[:, -1:]).sum(axis=1)
        return np.minimum(proposed, len(step.particles) - 1)


def _log_prob(
    frame_likelihood: FrameLikelihood, step: Step, later: Step, parents: IntArray, poses: FloatArray
) -> tuple[FloatArray, tuple[str, ...]]:
    """Return log likelihoods (M,) of the later step's poses (M, P) after particles (M,) of `step`, and warnings."""
    evaluation = frame_likelihood.evaluate(step.poses[parents], poses)
    log_prob, undefined = drop_undefined(evaluation.log_prob)
    return log_prob, (*(f"frame {later.frame.index}: {message}" for message in undefined), *evaluation.notes)


def _with_particles(step: Step, chosen: IntArray, log_weights: FloatArray, ancestors: IntArray, best: int) -> Step:
    """Return the step with chosen particles of it and new log weights."""
    poses = unwrap_near(step.poses[chosen], step.poses[chosen[best]])
    return replace(
        step, particles=step.particles[chosen], poses=poses, log_weights=log_weights, ancestors=ancestors,
        expected_pose=(np.exp(log_weights)[:, None] * poses).sum(axis=0), map_pose=poses[best],
        ess=effective_number(chosen, log_weights),
        diagnostics={**step.diagnostics, "unique_particles": float(len(np.unique(chosen)))},
    )  # fmt: skip
