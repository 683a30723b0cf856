"""Starting anew where the person is lost (paper A, section 8, its outlook)."""

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import replace
from functools import partial

import numpy as np

from workbench.arrays import FloatArray, IntArray
from workbench.body.skeleton import POSE_NAMES
from workbench.datasets.frame import Frame
from workbench.errors import InputError
from workbench.inference.particle_filter import Advanced, ParticleFilter, Particles, Stopwatch, filtered
from workbench.inference.resampling import systematic
from workbench.inference.step import Step
from workbench.likelihoods.likelihood import Likelihood
from workbench.priors.state import Prior, StateSpace

REFERENCE_FRAMES = 30
"""So many frames must have been tracked before one can tell that the evidence falls: it rises and falls in every cycle
of a walk, which takes about a second."""


class Restarting:
    """The particle filter for a person who may get lost.

    Lost is who has been explained badly for `patience` frames: each one's log p(frame | frames before) lies more than
    `drop` robust deviations (1.4826 times the median absolute deviation) below the median of the frames before them.
    Then a share of the previous frame's particles is replaced by draws from the prior's start distribution, half of
    them around the expected pose and half around its mirror image, since one camera easily takes left for right.

    It sees only what the likelihood can tell. Bare image motion cannot: a body that has come to rest on a still
    background predicts the next image better than the person did, and the evidence rises when the person is lost.

    As only the past decides, this is a filter for the prior (1 − share) p(s_t | s_t−1) + share p(s_t | start) in those
    frames, whose posterior and evidence need no correction. The ancestor of a particle that started anew is one of
    those it replaced, which it does not come from. Raises InputError for numbers out of range.
    """

    def __init__(
        self,
        prior: Prior,
        likelihood: Likelihood,
        *,
        n_particles: int = 5000,
        share: float = 0.2,
        drop: float = 4.0,
        patience: int = 3,
        ess_threshold: float = 1.0,
    ) -> None:
        if not (0.0 < share < 1.0 and 0.0 < drop < np.inf and patience >= 1):
            raise InputError(
                "inference: expected share between 0 and 1, drop above 0 and patience of at least 1, "
                f"found {share}, {drop} and {patience}"
            )
        self.filter = ParticleFilter(prior, likelihood, n_particles=n_particles, ess_threshold=ess_threshold)
        self.prior = prior
        self.space: StateSpace = prior.space
        self.share, self.drop, self.patience = share, drop, patience

    def run(
        self, frames: Iterable[Frame], start: FloatArray, rng_streams: Mapping[str, np.random.Generator]
    ) -> Iterator[Step]:
        """One step per frame, see `ParticleFilter.run`. The diagnostic restarted is 1 where particles started anew."""
        advance = partial(self._advance, [])
        first = {"restarted": 0.0}
        return filtered(
            self.prior, self.filter.likelihood, self.filter.n_particles, advance, frames, start, rng_streams, first
        )

    def _advance(
        self,
        gains: list[float],
        parents: Particles,
        previous: Frame,
        frame: Frame,
        rng_streams: Mapping[str, np.random.Generator],
        clock: Stopwatch,
    ) -> Advanced:
        """The filter's own step, after which its evidence joins the `gains`; they are forgotten when starting anew."""
        if not (restarts := lost(gains, self.patience, self.drop)):
            origins = np.arange(self.filter.n_particles)
        else:
            parents, origins = self._renewed(parents, rng_streams)
            gains.clear()
        advanced = self.filter.advance(parents, previous, frame, rng_streams, clock)
        gains.append(advanced.log_gain)
        said = (f"frame {frame.index}: the person seems lost; {self.share:.0%} of the particles start anew",)
        return replace(
            advanced,
            particles=replace(advanced.particles, ancestors=origins[advanced.particles.ancestors]),
            warnings=advanced.warnings + (said if restarts else ()),
            diagnostics={**advanced.diagnostics, "restarted": float(restarts)},
        )

    def _renewed(
        self, parents: Particles, rng_streams: Mapping[str, np.random.Generator]
    ) -> tuple[Particles, IntArray]:
        """The parents, resampled, with a share of them from the start distribution; and which each of them was."""
        rng, n = rng_streams["start"], self.filter.n_particles
        origins = systematic(np.exp(parents.log_weights), rng_streams["resampling"])
        state = parents.state[origins]
        anew = rng.permutation(n)[: int(np.ceil(self.share * n))]
        expected = (np.exp(parents.log_weights)[:, None] * parents.poses).sum(axis=0)
        for pose, which in ((expected, anew[::2]), (mirrored(expected), anew[1::2])):
            state[which] = self.prior.start(pose, len(which), rng)
        even = np.full(n, -np.log(n))
        return Particles(state, self.prior.pose(state), even, origins), origins


def lost(gains: list[float], patience: int, drop: float) -> bool:
    """Whether the last `patience` frames were explained much worse than those before, see `Restarting`."""
    before, last = gains[:-patience], gains[-patience:]
    if len(before) < REFERENCE_FRAMES:
        return False
    middle = np.median(before)
    deviation = 1.4826 * np.median(np.abs(np.array(before) - middle))
    return max(last) < float(middle - drop * deviation)


def mirrored(pose: FloatArray) -> FloatArray:
    """The pose (P,) with the joint angles of left and right exchanged; any other number of parameters as it is."""
    if len(pose) != len(POSE_NAMES):
        return pose
    swapped = {"left": "right", "right": "left"}
    sources = [
        POSE_NAMES.index(f"{swapped[side]}_{angle}") if side in swapped else i
        for i, (side, _, angle) in enumerate(name.partition("_") for name in POSE_NAMES)
    ]
    other: FloatArray = pose[sources]
    return other
