"""Smoothing: what a frame's pose was, given the frames after it too (Godsill, Doucet & West 2004)."""

from collections import deque
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import replace
from time import perf_counter

import numpy as np
from tqdm import tqdm

from workbench.arrays import FloatArray, IntArray
from workbench.datasets.frame import Frame
from workbench.errors import InputError
from workbench.inference.particle_filter import ParticleFilter, defined, effective_sample_size
from workbench.inference.resampling import systematic_draws
from workbench.inference.step import Step
from workbench.likelihoods.likelihood import Likelihood, Remembering
from workbench.priors.jitter import with_density
from workbench.priors.state import Prior, StateSpace

BLOCK = 2_000_000
"""Numbers held at once where every path is compared with every particle."""
LATE_MEMORY = "backward simulation: what the likelihood remembers after the last frame judged all frames' paths"


class FixedLag:
    """The particle filter, told `lag` frames late: p(state_t | frames up to t + lag) by ancestry.

    A particle of frame t + lag stands for its ancestor in frame t (Kitagawa 1996). It costs nothing, works with every
    prior, and streams; but resampling leaves few distinct ancestors after a long lag, which the diagnostic `distinct`
    counts. n_particles, resampling, ess_threshold: of the filter. lag: frames, at least 1. Raises InputError for
    numbers out of range.
    """

    def __init__(
        self,
        prior: Prior,
        likelihood: Likelihood,
        *,
        n_particles: int = 5000,
        lag: int = 5,
        resampling: str = "systematic",
        ess_threshold: float = 1.0,
    ) -> None:
        if lag < 1:
            raise InputError(f"inference: lag must be at least 1, found {lag}")
        self.filter = ParticleFilter(
            prior, likelihood, n_particles=n_particles, resampling=resampling, ess_threshold=ess_threshold
        )
        self.space: StateSpace = prior.space
        self.lag = lag

    def run(
        self, frames: Iterable[Frame], start: FloatArray, rng_streams: Mapping[str, np.random.Generator]
    ) -> Iterator[Step]:
        """One step per frame, each once `lag` more frames are seen; log_evidence is the filter's for that frame.

        rng_streams: generators named "start", "resampling" and "prior".
        """
        window: deque[Step] = deque()
        for step in self.filter.run(frames, start, rng_streams):
            window.append(step)
            if len(window) > self.lag:
                yield _looking_back(window, step.ancestors)
                window.popleft()
        while window:  # the last frames know of fewer that follow, and their particles are the same ones' ancestors
            yield _looking_back(window, np.arange(self.filter.n_particles))
            window.popleft()


class BackwardSimulation:
    """Paths drawn from p(all states | all frames), backwards over a particle filter's particles.

    The last state of a path is a particle of the last frame; then, backwards in time, particle i of frame t is drawn by

        w_t^i p(state_t+1 | state_t^i) p(frame_t+1 | pose_t+1, pose_t^i, frame_t, …)

    (Godsill, Doucet & West 2004, algorithm 1), the state of frame t + 1 being the one just drawn. Image motion depends
    on the previous pose as well, hence the last factor, whose evaluation for all particles and paths nobody can pay:
    `moves` Metropolis–Hastings moves propose particles by the first two factors and accept them by the third, starting
    from the ancestor (Bunch & Godsill 2013, section 3). Where the likelihood does not look at the previous pose every
    proposal is accepted, and one move is the algorithm itself.

    A likelihood with a memory is asked with what it remembers after the last frame, which the first step says.

    n_particles, ess_threshold: of the filter. n_paths: drawn, which become the equally weighted particles of the steps;
    a step's `map_pose` is that of the path with the highest density, the start's left out. The prior must have a
    density. Raises InputError for a prior without one and numbers out of range.
    """

    def __init__(
        self,
        prior: Prior,
        likelihood: Likelihood,
        *,
        n_particles: int = 5000,
        n_paths: int = 500,
        moves: int = 2,
        ess_threshold: float = 1.0,
    ) -> None:
        if n_paths < 1 or moves < 1:
            raise InputError(f"inference: n_paths and moves must be at least 1, found {n_paths} and {moves}")
        self.density = with_density(prior)
        self.filter = ParticleFilter(prior, likelihood, n_particles=n_particles, ess_threshold=ess_threshold)
        self.space: StateSpace = prior.space
        self.likelihood = likelihood
        self.n_paths, self.moves = n_paths, moves

    def run(
        self, frames: Iterable[Frame], start: FloatArray, rng_streams: Mapping[str, np.random.Generator]
    ) -> Iterator[Step]:
        """One step per frame, all of them once every frame is filtered and the paths are drawn.

        rng_streams: generators named "start", "resampling" and "prior". log_evidence is the filter's for that frame;
        ess is n_paths, its paths being equally weighted, and the diagnostic `distinct` tells how many differ.
        """
        forward = self.filter.run(frames, start, rng_streams)
        steps = list(tqdm(forward, desc="filter", unit="frame", disable=None, leave=False))
        if not steps:
            return
        rng = rng_streams["resampling"]
        chosen = systematic_draws(np.exp(steps[-1].log_weights), self.n_paths, rng)
        score = np.zeros(self.n_paths)
        smoothed = []
        for t in tqdm(range(len(steps) - 1, -1, -1), desc="backwards", unit="frame", disable=None, leave=False):
            began, later, picked = perf_counter(), steps[t], chosen
            if t > 0:
                chosen, gained, steps[t - 1], later = self._one_back(steps[t - 1], later, picked, rng)
                score = score + gained
            spent = {**later.timing_s, "smoothing": perf_counter() - began}
            smoothed.append((replace(later, timing_s=spent), picked))
        best = int(np.argmax(score))
        if isinstance(self.likelihood, Remembering):
            first, picked = smoothed[-1]
            smoothed[-1] = replace(first, warnings=(*first.warnings, LATE_MEMORY)), picked
        for step, picked in reversed(smoothed):
            yield _replaced(step, picked, np.full(self.n_paths, -np.log(self.n_paths)), np.arange(self.n_paths), best)

    def _one_back(
        self, step: Step, later: Step, chosen: IntArray, rng: np.random.Generator
    ) -> tuple[IntArray, FloatArray, Step, Step]:
        """The particles (M,) of `step` that come before those chosen of the later one; the log density (M,) of this
        part of the paths; both steps, the first with the share of moves accepted, the later with what they cost."""
        dt_s = later.frame.time_s - step.frame.time_s
        states, poses = later.particles[chosen], later.poses[chosen]
        current = later.ancestors[chosen]
        log_prob, more = self._log_prob(step, later, current, poses)
        said = [*later.warnings, *more]
        accepted = 0.0
        for proposed in self._proposed(step, states, dt_s, rng):
            proposed_log_prob, more = self._log_prob(step, later, proposed, poses)
            said += more
            with np.errstate(invalid="ignore"):  # −∞ − (−∞), where neither is possible
                accept = np.log1p(-rng.random(self.n_paths)) < proposed_log_prob - log_prob
            current = np.where(accept, proposed, current)
            log_prob = np.where(accept, proposed_log_prob, log_prob)
            accepted += float(accept.mean()) / self.moves
        gained = self.density.log_transition(step.particles[current], states, dt_s) + log_prob
        cost = later.evaluations + float(self.n_paths * (1 + self.moves))
        step = replace(step, diagnostics={**step.diagnostics, "acceptance": accepted})
        return current, gained, step, replace(later, evaluations=cost, warnings=tuple(dict.fromkeys(said)))

    def _log_prob(
        self, step: Step, later: Step, before: IntArray, poses: FloatArray
    ) -> tuple[FloatArray, tuple[str, ...]]:
        log_prob = self.likelihood.log_prob(step.frame, later.frame, step.poses[before], poses)
        log_prob, said = defined(later.frame, log_prob)
        return log_prob, said + self.likelihood.warnings()

    def _proposed(self, step: Step, states: FloatArray, dt_s: float, rng: np.random.Generator) -> IntArray:
        """Particles (moves, M) of `step`, drawn by their weights and the density of going on to states (M, D)."""
        uniforms = rng.random((self.moves, len(states)))
        proposed = np.empty(uniforms.shape, dtype=np.int64)
        rows = max(1, BLOCK // step.particles.size)
        for first in range(0, len(states), rows):
            block = slice(first, first + rows)
            odds = self.density.log_transition(step.particles[None], states[block, None], dt_s) + step.log_weights
            edges = np.cumsum(np.exp(odds - odds.max(axis=1, keepdims=True)), axis=1)  # the ancestor's is finite
            for move in range(self.moves):
                proposed[move, block] = (edges <= uniforms[move, block, None] * edges[:, -1:]).sum(axis=1)
        return np.minimum(proposed, len(step.particles) - 1)


def _looking_back(window: Iterable[Step], ancestors: IntArray) -> Step:
    """The window's first step, its particles being the ancestors of the last one's; `ancestors` of the result."""
    first, *later = window
    traced = np.arange(len(ancestors))
    for step in reversed(later):
        traced = step.ancestors[traced]
    weights = later[-1].log_weights if later else first.log_weights
    return _replaced(first, traced, weights, ancestors, int(np.argmax(weights)))


def _replaced(step: Step, picked: IntArray, log_weights: FloatArray, ancestors: IntArray, best: int) -> Step:
    """The step with some of its particles, weighted anew."""
    poses = step.poses[picked]
    return replace(
        step,
        particles=step.particles[picked],
        poses=poses,
        log_weights=log_weights,
        ancestors=ancestors,
        expected_pose=(np.exp(log_weights)[:, None] * poses).sum(axis=0),
        map_pose=poses[best],
        ess=effective_sample_size(log_weights),
        diagnostics={**step.diagnostics, "distinct": float(len(np.unique(picked)))},
    )
