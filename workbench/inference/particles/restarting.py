"""Starting anew where the person is lost (paper A, section 8, its outlook)."""

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import replace
from functools import partial

import numpy as np

from workbench.arrays import FloatArray, IntArray
from workbench.body.limbs import Body
from workbench.body.skeleton import POSE_NAMES
from workbench.datasets.frame import Frame
from workbench.errors import InputError
from workbench.inference.keypoint_start import start_from_keypoints
from workbench.inference.particle_filter import Advanced, ParticleFilter, Particles, Stopwatch, filtered, started_at
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
    Then a share of the previous frame's particles is replaced by draws from the prior's start distribution: around the
    poses that joints detected in that frame allow (`start_from_keypoints`), wherever they are, or without joints half
    of them around the expected pose and half around its mirror image, since one camera easily takes left for right.

    While they are explained no better, particles start anew every `patience` frames.

    It sees only what the likelihood can tell. Bare image motion cannot: a body that has come to rest on a still
    background predicts the next image better than the person did, and the evidence rises when the person is lost.

    As only the past decides, this is a filter for the prior (1 − share) p(s_t | s_t−1) + share p(s_t | start) in those
    frames, whose posterior and evidence need no correction. (Detected joints are not part of the likelihood, and so no
    evidence is used twice.) The ancestor of a particle that started anew is one of those it replaced, which it does not
    come from.

    body: whose joints are detected; None: they are not looked at. Raises InputError for numbers out of range.
    """

    def __init__(
        self,
        prior: Prior,
        likelihood: Likelihood,
        *,
        body: Body | None = None,
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
        self.prior, self.body = prior, body
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
        """The filter's own step, after which its evidence joins the `gains`; those of a loss are forgotten."""
        origins, said = np.arange(self.filter.n_particles), tuple[str, ...]()
        if lost(gains, self.patience, self.drop):
            starts, where = self._starts(parents, previous)
            parents, origins = self._renewed(parents, starts, rng_streams)
            del gains[-self.patience :]  # no measure for those who are found
            clock.lap("start")
            lament = f"frame {frame.index}: the person seems lost; {self.share:.0%} of the particles start anew"
            said = (f"{lament} {where}",)
        advanced = self.filter.advance(parents, previous, frame, rng_streams, clock)
        gains.append(advanced.log_gain)
        return replace(
            advanced,
            particles=replace(advanced.particles, ancestors=origins[advanced.particles.ancestors]),
            warnings=advanced.warnings + said,
            diagnostics={**advanced.diagnostics, "restarted": float(bool(said))},
        )

    def _starts(self, parents: Particles, frame: Frame) -> tuple[FloatArray, str]:
        """The poses (n, P) to start anew from in the parents' frame, and in words where that is."""
        if self.body is not None and any(view.keypoints is not None for view in frame.views):
            try:
                found = start_from_keypoints(self.body.skeleton, [frame])
            except InputError:  # too few joints; the sentence of the restart tells where it was from instead
                pass
            else:
                return found, "from the joints detected"
        expected = (np.exp(parents.log_weights)[:, None] * parents.poses).sum(axis=0)
        return np.stack([expected, mirrored(expected)]), "about the last pose and its mirror image"

    def _renewed(
        self, parents: Particles, starts: FloatArray, rng_streams: Mapping[str, np.random.Generator]
    ) -> tuple[Particles, IntArray]:
        """The parents, resampled, with a share of them around the poses (n, P); and which each of them was."""
        rng, n = rng_streams["start"], self.filter.n_particles
        origins = systematic(np.exp(parents.log_weights), rng_streams["resampling"])
        state = parents.state[origins]
        anew = rng.permutation(n)[: int(np.ceil(self.share * n))]
        state[anew] = started_at(self.prior, starts, len(anew), rng)
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
