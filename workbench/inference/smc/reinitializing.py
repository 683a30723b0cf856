"""Starting anew where the person is lost (paper A, section 8, its outlook)."""

from collections.abc import Iterable, Iterator, Mapping
from contextlib import suppress
from dataclasses import KW_ONLY, dataclass, replace
from functools import partial
from typing import Any, ClassVar

import numpy as np

from workbench.body.angles import exchanged
from workbench.body.limbs import Body
from workbench.core.capabilities import KEYPOINTS, Traits, needs_of_all, offering
from workbench.core.checks import INSIDE_UNIT, check
from workbench.core.filter_state import Past
from workbench.core.frame import Frame
from workbench.core.step import Step
from workbench.inference.initialization.from_keypoints import start_from_keypoints
from workbench.inference.smc.move import Kind, Move, Streams, WrappedMove, Wrapper
from workbench.inference.smc.particle_filter import start_around
from workbench.inference.smc.target import MoveResult, Particles, Target
from workbench.inference.smc.weights import even_log_weights, systematic
from workbench.utils.arrays import FloatArray, IntArray
from workbench.utils.errors import InputError

DROP, PATIENCE = 4.0, 3
"""By how many robust deviations the evidence of how many last frames must lie below that of the frames before."""
REFERENCE_FRAMES = 30
"""So many frames must have been tracked before one can tell that the evidence falls: it rises and falls in every cycle
of a walk, which takes about a second."""


@dataclass(frozen=True, eq=False)
class Restarting(Wrapper):
    """Replace some of the particles where the person is lost.

    The person counts as lost where each of the last PATIENCE frames' log p(frame | frames before) lies more than DROP
    robust deviations (1.4826 times the median absolute deviation) below the median of the frames before them. Then a
    share of the previous frame's particles is drawn from the prior's start distribution: around the poses that detected
    joints allow in that frame (`start_from_keypoints`), or else half of them around the expected pose and half around
    its mirror image. The diagnostic restarted is 1 in such a frame; it can recur every PATIENCE frames.

    Bare image motion does not show a loss: a body at rest on a still background predicts the next image well. Neither
    does a move that estimates no evidence, such as the annealed one.

    As only the past decides, this is a filter for the prior (1 − share) p(s_t | s_t−1) + share p(s_t | start) in those
    frames, whose posterior and evidence need no correction; a likelihood that weighs detected joints is refused. The
    ancestor of a replaced particle is the one it replaced.

    filter: of any move. body: whose joints are detected; None: they are not used. Raises InputError for a share out of
    range.
    """

    @staticmethod
    def traits(keys: Mapping[str, Any]) -> Traits:
        """Declare what the filter needs, and that the joints it starts from are not weighed again."""
        return Traits(requires=needs_of_all({"filter": keys["filter"], "restarts": offering(apart=KEYPOINTS)}))

    body: Body | None = None
    _: KW_ONLY
    share: float = 0.2

    kind: ClassVar[Kind] = "restarted"

    def __post_init__(self) -> None:
        super().__post_init__()
        check("inference", self, share=INSIDE_UNIT)

    def run(self, frames: Iterable[Frame], start: FloatArray | Past | None, rng_streams: Streams) -> Iterator[Step]:
        """Yield one step per frame, see `ParticleFilter.run`; restarts draw from "start" and "resampling"."""
        gains: list[float] = []
        if isinstance(start, Past) and "gains" in start.memory.arrays:  # not after a filter alone
            gains = start.memory.array("gains", None).tolist()
        move = WrappedMove(self.move, partial(self._around, gains), {"reinitialized": 0.0})
        for step in self.filter.rebuilt(move=move).run(frames, start, rng_streams):
            yield replace(step, memory=step.memory and step.memory.plus(gains=np.array(gains)))

    def _around(self, gains: list[float], move: Move, target: Target, rng_streams: Streams) -> MoveResult:
        """Renew the parents if need be and move; the evidence joins the `gains`, those of a loss are forgotten."""
        origins, warning = np.arange(target.n), tuple[str, ...]()
        if lost(gains):
            starts, where = self._starts(target.parents, target.previous)
            parents = self._renewed(target.parents, starts, rng_streams)
            target, origins = replace(target, parents=parents), parents.ancestors
            del gains[-PATIENCE:]  # no measure for those who are found
            target.clock.lap("start")
            lament = f"frame {target.frame.index}: the person seems lost; {self.share:.0%} of the particles start anew"
            warning = (f"{lament} {where}",)
        moved = move(target, rng_streams)
        gains.append(moved.log_gain)
        particles = replace(moved.particles, ancestors=origins[moved.particles.ancestors])
        diagnostics = {**moved.diagnostics, "reinitialized": float(bool(warning))}
        return replace(moved, particles=particles, warnings=moved.warnings + warning, diagnostics=diagnostics)

    def _starts(self, parents: Particles, frame: Frame) -> tuple[FloatArray, str]:
        """Find poses (n, P) to start anew from in the parents' frame, and say in words where that is."""
        if self.body is not None and any(view.keypoints is not None for view in frame.views):
            # where there are too few joints, the sentence of the restart tells where it was from instead
            with suppress(InputError):
                return start_from_keypoints(self.body.skeleton, [frame]), "from the joints detected"
        expected = (np.exp(parents.log_weights)[:, None] * parents.poses).sum(axis=0)
        return np.stack([expected, exchanged(expected)]), "about the last pose and its mirror image"

    def _renewed(self, parents: Particles, starts: FloatArray, rng_streams: Streams) -> Particles:
        """Resample the parents and start a share of them around the poses (n, P); ancestors say which each was."""
        rng, n = rng_streams["start"], len(parents.log_weights)
        origins: IntArray = systematic(np.exp(parents.log_weights), rng_streams["resampling"])
        state = parents.state[origins]
        anew = rng.permutation(n)[: int(np.ceil(self.share * n))]
        state[anew] = start_around(self.prior, starts, len(anew), rng)
        return Particles(state, self.prior.pose(state), even_log_weights(n), origins)


def lost(gains: list[float]) -> bool:
    """Return whether the last PATIENCE frames were explained much worse than those before, see `Restarting`."""
    before, last = gains[:-PATIENCE], gains[-PATIENCE:]
    if len(before) < REFERENCE_FRAMES:
        return False
    middle = np.median(before)
    deviation = 1.4826 * np.median(np.abs(np.array(before) - middle))
    return max(last) < float(middle - DROP * deviation)
