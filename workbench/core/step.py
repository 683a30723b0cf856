"""One frame's result, and what every inference offers."""

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, field
from functools import cached_property
from typing import Protocol, TypeGuard, runtime_checkable

import numpy as np

from workbench.core.filter_state import Memory, Past
from workbench.core.frame import Frame
from workbench.core.state_space import StateSpace
from workbench.utils.arrays import BoolArray, FloatArray, IntArray

_FEW = 16
"""Particles that differ among themselves in all that is not held fixed, as nearly always."""


@dataclass(frozen=True, eq=False)
class Step:
    """The posterior at one frame as N weighted particles, and its summaries.

    particles: (N, D) states, columns named by `space`. poses: (N, P) the same particles decoded. log_weights: (N,),
    normalised (their exponentials sum to one). ancestors: (N,) index of each particle's parent among the previous
    step's particles. expected_pose: (P,) Σ w φ (paper A, section 7). map_pose: (P,) the pose of the heaviest particle.
    ess: effective sample size 1 / Σ w². log_evidence: log p(frames so far), NaN by inferences that
    do not estimate it. activity: what the person is told to do,
    such as "walk", by inferences that tell it. attachment: (K,) the part of the body that each of the frame's points
    belongs to, as a number, -1 for none. diagnostics: scalars worth a curve. warnings: sentences for the person who
    runs this. evaluations: how often the likelihood was evaluated for this frame, for one pose each, or the residual by
    inferences that solve. timing_s: seconds spent per stage. memory: what the inference goes on from after this frame,
    None by those that cannot.
    """

    frame: Frame
    space: StateSpace
    particles: FloatArray
    poses: FloatArray
    log_weights: FloatArray
    ancestors: IntArray
    expected_pose: FloatArray
    map_pose: FloatArray
    ess: float
    log_evidence: float
    activity: str | None = None
    attachment: IntArray | None = None
    diagnostics: Mapping[str, float] = field(default_factory=dict)
    warnings: tuple[str, ...] = ()
    evaluations: float = 0.0
    timing_s: Mapping[str, float] = field(default_factory=dict)
    memory: Memory | None = None

    @cached_property
    def spread(self) -> BoolArray:
        """Select (P,), the pose's numbers in which the particles differ; the others are held fixed by the prior."""
        found = (self.poses[:_FEW] != self.poses[0]).any(axis=0)
        return found if found.all() else (self.poses != self.poses[0]).any(axis=0)


class Inference(Protocol):
    """Turns frames into steps. space: names and units of the columns of its steps' particles. finds_start: whether it
    finds the first pose itself where nobody gives one."""

    @property
    def space(self) -> StateSpace: ...
    @property
    def finds_start(self) -> bool: ...

    def run(
        self, frames: Iterable[Frame], start: FloatArray | None, rng_streams: Mapping[str, np.random.Generator]
    ) -> Iterator[Step]:
        """Yield one step per frame, from the pose `start` (P,), which some can do without, by the named generators."""


@runtime_checkable
class Resumable(Protocol):
    """An inference whose steps have a memory and that, where `resumable` says so, takes a `Past` for a start: it then
    looks at the frames of this again and yields the steps of those after them, bit by bit as if it had tracked all."""

    @property
    def resumable(self) -> bool: ...

    def run(
        self, frames: Iterable[Frame], start: FloatArray | Past | None, rng_streams: Mapping[str, np.random.Generator]
    ) -> Iterator[Step]:
        """Yield the steps as `Inference.run` does, or those after the past."""


def resumable(inference: Inference) -> TypeGuard[Resumable]:
    """Return whether the inference can go on from a frame."""
    return isinstance(inference, Resumable) and inference.resumable
