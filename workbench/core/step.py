"""One frame's result."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property

from workbench.arrays import BoolArray, FloatArray, IntArray
from workbench.core.frame import Frame
from workbench.core.state_space import StateSpace


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
    inferences that solve. timing_s: seconds spent per stage.
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

    @cached_property
    def spread(self) -> BoolArray:
        """(P,): the pose's numbers in which the particles differ; the others are held fixed by the prior."""
        differ: BoolArray = (self.poses != self.poses[0]).any(axis=0)
        return differ
