"""Smoothing: what a frame's pose was, given the frames after it too (Godsill, Doucet & West 2004)."""

from collections import deque
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import KW_ONLY, dataclass, replace
from itertools import accumulate
from typing import Any, ClassVar

import numpy as np
from tqdm import tqdm

from workbench.body.angles import nearest_turn
from workbench.core.capabilities import DENSITY, Traits, needs_of_all, offering
from workbench.core.checks import at_least, check
from workbench.core.filter_state import Past
from workbench.core.frame import Frame
from workbench.core.likelihood import FrameLikelihood
from workbench.core.step import Step
from workbench.inference.smc.move import Kind, Move, Streams, WrappedMove, Wrapper
from workbench.inference.smc.target import MoveResult, Target, density_of
from workbench.inference.smc.weights import drop_undefined, effective_number, even_log_weights, systematic
from workbench.utils.arrays import FloatArray, IntArray
from workbench.utils.timing import working_s

BLOCK = 2_000_000
"""Numbers held at once where every path is compared with every particle."""


@dataclass(frozen=True, eq=False)
class FixedLag(Wrapper):
    """A particle filter reported `lag` frames late: p(state_t | frames up to t + lag) by ancestry (Kitagawa 1996).

    It costs nothing, works with every prior, and streams; but every resampling leaves fewer distinct ancestors. So a
    frame is reported given the latest frame, up to t + lag, whose particles have at least `least_ancestors` in it,
    effectively: 1 / Σ_a (Σ_i w_i)², i over the particles of ancestor a; at worst its own. (Even n independent draws
    from the posterior span a 5–95 % band that holds the truth in (n − 1) / (n + 1) of all cases only, as long as n <
    20.) The diagnostic `lag` is how many frames later that is.

    filter: of any move, restarting or not. lag: frames, at least 1. Raises InputError for numbers out of range.
    """

    _: KW_ONLY
    lag: int = 5
    least_ancestors: int = 50

    wraps: ClassVar[tuple[Kind, ...]] = ("filtered", "restarted")
    kind: ClassVar[Kind] = "smoothed"

    def __post_init__(self) -> None:
        super().__post_init__()
        check("inference", self, lag=at_least(1), least_ancestors=at_least(1))

    def run(self, frames: Iterable[Frame], start: FloatArray | Past | None, rng_streams: Streams) -> Iterator[Step]:
        """Yield one step per frame, each once `lag` more frames are seen; log_evidence is the filter's for that frame.
        rng_streams: as for the filter. ess and the diagnostic `unique_particles` count ancestors. A step's memory is of
        its own frame: who goes on from it filters the `lag` frames after it again."""
        window, ahead = deque[Step](), 0
        if isinstance(start, Past) and "ahead" in start.memory.arrays:  # not after a filter alone
            ahead = min(int(start.memory.array("ahead", 1)[0]), self.lag)
        for step in self.filter.run(frames, start, rng_streams):
            window.append(step)
            if len(window) > self.lag:
                looked_back, ahead = self._looking_back(window, ahead)
                yield looked_back
                window.popleft()
        while window:  # the last frames know of fewer that follow
            looked_back, ahead = self._looking_back(window, ahead)
            yield looked_back
            window.popleft()

    def _looking_back(self, window: Iterable[Step], before: int) -> tuple[Step, int]:
        """Return the window's first step, its particles being ancestors of a later one's, and how much later that one
        is. before: the same of the frame before, to whose particles the result's `ancestors` point."""
        first, *later = window
        # of a step's particles, their ancestors in the first step
        own = np.arange(len(first.ancestors))
        lineages = list(accumulate(later, lambda lineage, step: lineage[step.ancestors], initial=own))
        enough = [
            effective_number(lineage, step.log_weights) >= self.least_ancestors
            for lineage, step in zip(lineages, (first, *later), strict=True)
        ]
        # never before the frame that told of the last one: ancestors there are ancestors of those here, and not more
        ahead = max([before - 1, 0, *np.flatnonzero(enough)])
        parents = own
        for step in (first, *later)[before : ahead + 1]:
            parents = parents[step.ancestors]
        weights = (first, *later)[ahead].log_weights
        looked_back = _replaced(first, lineages[ahead], weights, parents, int(np.argmax(weights)))
        diagnostics, memory = {**looked_back.diagnostics, "lag": float(ahead)}, first.memory
        memory = memory and memory.plus(ahead=np.array([ahead]))
        return replace(looked_back, diagnostics=diagnostics, memory=memory), ahead


@dataclass(frozen=True, eq=False)
class BackwardSimulation(Wrapper):
    """Paths drawn from p(all states | all frames), backwards over a particle filter's particles.

    The last state of a path is a particle of the last frame; then, backwards in time, particle i of frame t is drawn by

        w_t^i p(state_t+1 | state_t^i) p(frame_t+1 | pose_t+1, pose_t^i, frame_t, …)

    (Godsill, Doucet & West 2004, algorithm 1), the state of frame t + 1 being the one just drawn. The last factor is
    there for likelihoods of the previous pose: instead of evaluating it for all particles and paths, `moves`
    Metropolis–Hastings moves propose particles by the first two factors and accept them by the third, starting from the
    ancestor (Bunch & Godsill 2013, section 3). Without it every proposal is accepted, and one move is the algorithm
    itself. Each frame's look, memory included, is kept until the paths are drawn.

    Where a state has many columns with noise, hardly any particle but the ancestor leads to a given state. So a frame
    in which the paths go through fewer than `least_ancestors` particles, effectively, is reported as by the filter, and
    the paths start anew from there. The diagnostic `lag` is the number of later frames that were used. (There,
    `ancestors` leads from one path to another that does not go on from it.)

    filter: of any move, for a prior with a density. n_paths: drawn, which become the equally weighted particles of the
    steps; a step's `map_pose` is that of the path with the highest density, the start's left out. Raises InputError for
    a prior without a density and numbers out of range."""

    @staticmethod
    def traits(keys: Mapping[str, Any]) -> Traits:
        """Declare what the filter needs, and a density."""
        return Traits(requires=needs_of_all({"filter": keys["filter"], "paths": offering(prior=DENSITY)}))

    _: KW_ONLY
    n_paths: int = 500
    moves: int = 2
    least_ancestors: int = 50

    kind: ClassVar[Kind] = "smoothed"
    resumable: ClassVar[bool] = False

    def __post_init__(self) -> None:
        super().__post_init__()
        density_of(self.prior)
        check("inference", self, n_paths=at_least(1), moves=at_least(1), least_ancestors=at_least(1))

    def run(self, frames: Iterable[Frame], start: FloatArray | None, rng_streams: Streams) -> Iterator[Step]:
        """Yield one step per frame, all of them once every frame is filtered and the paths are drawn.

        rng_streams: as for the filter, and "resampling" for the paths. log_evidence is the filter's for that frame; ess
        counts the particles that the paths go through, and so does the diagnostic `unique_particles`, however many
        paths.
        """
        frame_likelihoods: list[FrameLikelihood] = []

        def keep_look(move: Move, target: Target, rng_streams: Streams) -> MoveResult:
            frame_likelihoods.append(target.frame_likelihood)
            return move(target, rng_streams)

        forward = self.filter.rebuilt(move=WrappedMove(self.move, keep_look)).run(frames, start, rng_streams)
        forward = (replace(step, memory=None) for step in forward)  # no path goes on, and it would be kept for all
        steps = list(tqdm(forward, desc="filter", unit="frame", disable=None, leave=False))
        yield from reversed(list(self._backwards(steps, frame_likelihoods, rng_streams["resampling"])))

    def _backwards(
        self, steps: list[Step], frame_likelihoods: list[FrameLikelihood], rng: np.random.Generator
    ) -> Iterator[Step]:
        """Return the steps with paths for particles, the last one first; looks: of all frames but the first."""
        even = even_log_weights(self.n_paths)
        score, stretch, chosen = np.zeros(self.n_paths), list[tuple[Step, IntArray]](), np.zeros(0, dtype=np.int64)
        for t in tqdm(range(len(steps) - 1, -1, -1), desc="backwards", unit="frame", disable=None, leave=False):
            began = working_s()
            if stretch:
                chosen, gained, step, later = self._one_back(steps[t], *stretch[-1], frame_likelihoods[t], rng)
                score, stretch[-1] = score + gained, (later, stretch[-1][1])
            if not stretch or effective_number(chosen, even) < self.least_ancestors:
                yield from self._told(stretch, score)
                step, score, stretch = steps[t], np.zeros(self.n_paths), []
                chosen = systematic(np.exp(step.log_weights), rng, self.n_paths)
            spent = {**step.timing_s, "smoothing": working_s() - began}
            stretch.append((replace(step, timing_s=spent), chosen))
        yield from self._told(stretch, score)

    def _told(self, stretch: list[tuple[Step, IntArray]], score: FloatArray) -> Iterator[Step]:
        """Yield a stretch's steps, the last one first, with the particles (M,) that the paths go through."""
        even, best = even_log_weights(self.n_paths), int(np.argmax(score))
        for lag, (step, picked) in enumerate(stretch):
            smoothed = _replaced(step, picked, even, np.arange(self.n_paths), best)
            yield replace(smoothed, diagnostics={"acceptance_rate": 1.0, **smoothed.diagnostics, "lag": float(lag)})

    def _one_back(
        self, step: Step, later: Step, chosen: IntArray, frame_likelihood: FrameLikelihood, rng: np.random.Generator
    ) -> tuple[IntArray, FloatArray, Step, Step]:
        """Return the particles (M,) of `step` that come before those chosen of the later one; the log density (M,) of
        this part of the paths; both steps, the first with the share of moves accepted, the later with what they
        cost."""
        dt_s = later.frame.time_s - step.frame.time_s
        states, poses = later.particles[chosen], later.poses[chosen]
        current = later.ancestors[chosen]
        log_prob, more = _log_prob(frame_likelihood, step, later, current, poses)
        warnings = [*later.warnings, *more]
        accepted = 0.0
        for proposed in self._proposed(step, states, dt_s, rng):
            proposed_log_prob, more = _log_prob(frame_likelihood, step, later, proposed, poses)
            warnings += more
            with np.errstate(invalid="ignore"):  # −∞ − (−∞), where neither is possible
                accept = np.log1p(-rng.random(self.n_paths)) < proposed_log_prob - log_prob
            current = np.where(accept, proposed, current)
            log_prob = np.where(accept, proposed_log_prob, log_prob)
            accepted += float(accept.mean()) / self.moves
        gained = density_of(self.prior).log_transition(step.particles[current], states, dt_s) + log_prob
        cost = later.evaluations + float(self.n_paths * (1 + self.moves))
        step = replace(step, diagnostics={**step.diagnostics, "acceptance_rate": accepted})
        return current, gained, step, replace(later, evaluations=cost, warnings=tuple(dict.fromkeys(warnings)))

    def _proposed(self, step: Step, states: FloatArray, dt_s: float, rng: np.random.Generator) -> IntArray:
        """Draw particles (moves, M) of `step` by their weights and the density of going on to states (M, D)."""
        uniforms = rng.random((self.moves, len(states)))
        proposed = np.empty(uniforms.shape, dtype=np.int64)
        rows = max(1, BLOCK // step.particles.size)
        for first in range(0, len(states), rows):
            block = slice(first, first + rows)
            onward = density_of(self.prior).log_transition(step.particles[None], states[block, None], dt_s)
            odds = onward + step.log_weights
            edges = np.cumsum(np.exp(odds - odds.max(axis=1, keepdims=True)), axis=1)  # the ancestor's is finite
            for move in range(self.moves):
                proposed[move, block] = (edges <= uniforms[move, block, None] * edges[:, -1:]).sum(axis=1)
        return np.minimum(proposed, len(step.particles) - 1)


def _log_prob(
    frame_likelihood: FrameLikelihood, step: Step, later: Step, before: IntArray, poses: FloatArray
) -> tuple[FloatArray, tuple[str, ...]]:
    """Return log likelihoods (M,) of the later step's poses (M, P) after particles (M,) of `step`, and warnings."""
    evaluation = frame_likelihood.evaluate(step.poses[before], poses)
    log_prob, undefined = drop_undefined(evaluation.log_prob)
    return log_prob, (*(f"frame {later.frame.index}: {sentence}" for sentence in undefined), *evaluation.notes)


def _replaced(step: Step, picked: IntArray, log_weights: FloatArray, ancestors: IntArray, best: int) -> Step:
    """Return the step with some of its particles, weighted anew."""
    poses = nearest_turn(step.poses[picked], step.poses[picked[best]])
    return replace(
        step, particles=step.particles[picked], poses=poses, log_weights=log_weights, ancestors=ancestors,
        expected_pose=(np.exp(log_weights)[:, None] * poses).sum(axis=0), map_pose=poses[best],
        ess=effective_number(picked, log_weights),
        diagnostics={**step.diagnostics, "unique_particles": float(len(np.unique(picked)))},
    )  # fmt: skip
