"""Reinitialization of particles when track is lost (paper A, section 8, its outlook)."""

from collections.abc import Iterable, Iterator, Mapping
from contextlib import suppress
from dataclasses import KW_ONLY, dataclass, replace
from functools import partial
from typing import Any, ClassVar

import numpy as np

from workbench.body.angles import swap_left_right
from workbench.body.limbs import Body
from workbench.core.capabilities import KEYPOINTS, Traits, combined_requirements, component_traits
from workbench.core.checks import INSIDE_UNIT, check
from workbench.core.frame import Frame
from workbench.core.step import Step
from workbench.inference.initialization.from_keypoints import poses_from_keypoints
from workbench.inference.smc.move import Kind, Move, Streams, WrappedMove, Wrapper
from workbench.inference.smc.particle_filter import sample_start
from workbench.inference.smc.target import MoveResult, Particles, Target
from workbench.inference.smc.weights import systematic, uniform_log_weights
from workbench.utils.arrays import FloatArray, IntArray
from workbench.utils.errors import InputError

DROP_THRESHOLD, PATIENCE = 4.0, 3
"""Number of robust deviations by which the evidence must fall, and number of consecutive frames for which it must."""
REFERENCE_FRAMES = 30
"""Minimum number of earlier frames: the evidence rises and falls in every cycle of a walk, of about a second."""


@dataclass(frozen=True, eq=False)
class Reinitializing(Wrapper):
    """Replace a fraction of the particles when track is lost.

    Track counts as lost if log p(frame | frames before) of each of the last PATIENCE frames is more than DROP_THRESHOLD
    robust deviations (1.4826 times the median absolute deviation) below the median of the frames before them. Then a
    fraction of the previous frame's particles is sampled from the prior's initial distribution: at the poses that
    detected joints allow in that frame (`poses_from_keypoints`), or else half of them at the expected pose and half at
    its mirror image. The diagnostic reinitialized is 1 in such a frame; it can recur every PATIENCE frames.

    Image motion alone does not indicate a lost track: a body at rest on a static background predicts the next image
    well. Neither does a move that estimates no evidence, such as the annealed one.

    As the decision depends only on earlier frames, this is a filter for the prior
    (1 − ρ) p(s_t | s_t−1) + ρ p(s_t | initial) in those frames, with ρ = reinitialized_fraction; its posterior and
    evidence need no correction. A likelihood that uses detected joints is refused. The ancestor of a replaced particle
    is the one that it replaced.

    filter: with any algorithm. body: whose joints are detected; None: they are not used. Raises InputError for a
    reinitialized_fraction out of range.
    """

    @staticmethod
    def traits(keys: Mapping[str, Any]) -> Traits:
        """Declare the filter's requirements, and that the likelihood must not use the joints."""
        joints = component_traits(conflicting_observations=KEYPOINTS)
        return Traits(requires=combined_requirements({"filter": keys["filter"], "joints": joints}))

    body: Body | None = None
    _: KW_ONLY
    reinitialized_fraction: float = 0.2

    kind: ClassVar[Kind] = "reinitialized"

    def __post_init__(self) -> None:
        super().__post_init__()
        check("inference", self, reinitialized_fraction=INSIDE_UNIT)

    def run(self, frames: Iterable[Frame], start: FloatArray | None, rng_streams: Streams) -> Iterator[Step]:
        """Yield one step per frame, see `ParticleFilter.run`; reinitialization uses "start" and "resampling"."""
        around = partial(self._reinitialize_and_move, list[float]())
        move = WrappedMove(self.algorithm, around, {"reinitialized": 0.0})
        return self.filter.rebuilt(algorithm=move).run(frames, start, rng_streams)

    def _reinitialize_and_move(
        self, log_gains: list[float], move: Move, target: Target, rng_streams: Streams
    ) -> MoveResult:
        """Reinitialize parents if track is lost, then move; append the evidence to `log_gains`.

        The evidence of the frames that showed the loss is removed.
        """
        origins, warning = np.arange(target.n), tuple[str, ...]()
        if track_lost(log_gains):
            poses, where = self._initial_poses(target.parents, target.previous)
            parents = self._reinitialized(target.parents, poses, rng_streams)
            target, origins = replace(target, parents=parents), parents.ancestors
            del log_gains[-PATIENCE:]  # not representative after reinitialization
            target.clock.lap("start")
            event = f"frame {target.frame.index}: track lost"
            warning = (f"{event}; reinitialized {self.reinitialized_fraction:.0%} of the particles {where}",)
        result = move(target, rng_streams)
        log_gains.append(result.log_gain)
        particles = replace(result.particles, ancestors=origins[result.particles.ancestors])
        diagnostics = {**result.diagnostics, "reinitialized": float(bool(warning))}
        return replace(result, particles=particles, warnings=result.warnings + warning, diagnostics=diagnostics)

    def _initial_poses(self, parents: Particles, frame: Frame) -> tuple[FloatArray, str]:
        """Return poses (n, P) to reinitialize at in the parents' frame, and a description of them."""
        if self.body is not None and any(view.keypoints is not None for view in frame.views):
            with suppress(InputError):  # too few joints: the description names the other poses instead
                return poses_from_keypoints(self.body.skeleton, [frame]), "at the detected joints"
        expected = (np.exp(parents.log_weights)[:, None] * parents.poses).sum(axis=0)
        return np.stack([expected, swap_left_right(expected)]), "at the last pose and its mirror image"

    def _reinitialized(self, parents: Particles, poses: FloatArray, rng_streams: Streams) -> Particles:
        """Return the resampled parents, a fraction of them sampled at poses (n, P); ancestors index the given ones."""
        rng, n = rng_streams["start"], len(parents.log_weights)
        origins: IntArray = systematic(np.exp(parents.log_weights), rng_streams["resampling"])
        state = parents.state[origins]
        replaced = rng.permutation(n)[: int(np.ceil(self.reinitialized_fraction * n))]
        state[replaced] = sample_start(self.prior, poses, len(replaced), rng)
        return Particles(state, self.prior.pose(state), uniform_log_weights(n), origins)


def track_lost(log_gains: list[float]) -> bool:
    """Return whether the last PATIENCE frames have much less evidence than those before, see `Reinitializing`."""
    earlier, last = log_gains[:-PATIENCE], log_gains[-PATIENCE:]
    if len(earlier) < REFERENCE_FRAMES:
        return False
    median = np.median(earlier)
    deviation = 1.4826 * np.median(np.abs(np.array(earlier) - median))
    return max(last) < float(median - DROP_THRESHOLD * deviation)
