"""The posterior of one frame, and the interface of inference methods."""

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Protocol

import numpy as np

from workbench.body.kinematics import JointFrames, forward
from workbench.body.skeleton import Skeleton
from workbench.core.frame import Frame
from workbench.core.state_space import StateSpace
from workbench.utils.arrays import BoolArray, FloatArray, IntArray

_FEW = 16
"""Number of particles that nearly always suffice to find the parameters that vary."""


@dataclass(frozen=True, eq=False)
class Step:
    """The posterior at one frame as N weighted particles, and its summaries.

    particles: (N, D) states, columns named by `space`. poses: (N, P) the same particles decoded. log_weights: (N,),
    normalised (their exponentials sum to one). ancestors: (N,) index of each particle's parent among the previous
    step's particles. expected_pose: (P,) Σ w φ (paper A, section 7). map_pose: (P,) the pose of the particle with the
    largest weight. ess: effective sample size 1 / Σ w². log_evidence: log p(frames so far), NaN if the inference does
    not estimate it. activity: the estimated activity, such as "walk", of inferences that estimate it. attachment: (K,)
    the number of the body part that each of the frame's points belongs to, -1 for none. diagnostics: scalars to plot.
    warnings: messages for the user. evaluations: number of evaluations of the likelihood for this frame, one pose each,
    or of the residual by least squares. timing_s: seconds by stage. draws: (S, P), poses; row s of all frames is one
    sample of the whole motion from the posterior, with the errors' correlation over time, of inferences that know it.
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
    draws: FloatArray | None = None

    @cached_property
    def spread(self) -> BoolArray:
        """Select (P,), the pose parameters in which the particles differ; the prior fixes the others."""
        varying = (self.poses[:_FEW] != self.poses[0]).any(axis=0)
        return varying if varying.all() else (self.poses != self.poses[0]).any(axis=0)

    def expected_frames(self, skeleton: Skeleton) -> JointFrames:
        """Return the world frames of the skeleton's joints in the expected pose, N = 1; computed once."""
        if skeleton not in self._expected_frames:
            self._expected_frames[skeleton] = forward(skeleton, self.expected_pose[None])
        return self._expected_frames[skeleton]

    def expected_joints(self, skeleton: Skeleton) -> FloatArray:
        """Return the joints (J, 3), m, in the expected pose."""
        return self.expected_frames(skeleton).positions[0]

    def first_parameters(self, n: int) -> "Step":
        """Return the step of the first n parameters of its poses: of a person with feet, the person's without."""
        if n == len(self.expected_pose):
            return self
        expected = self.expected_pose[:n]
        is_equal = self.map_pose is self.expected_pose
        return replace(
            self, poses=np.ascontiguousarray(self.poses[:, :n]), expected_pose=expected,
            map_pose=expected if is_equal else self.map_pose[:n],
        )  # fmt: skip

    @cached_property
    def _expected_frames(self) -> dict[Skeleton, JointFrames]:
        return {}


class Inference(Protocol):
    """Estimator of one step per frame. space: names and units of the columns of its particles. finds_start: whether it
    estimates the initial pose itself if none is given."""

    @property
    def space(self) -> StateSpace: ...
    @property
    def finds_start(self) -> bool: ...

    def run(
        self, frames: Iterable[Frame], start: FloatArray | None, rng_streams: Mapping[str, np.random.Generator]
    ) -> Iterator[Step]:
        """Yield one step per frame, from the initial pose `start` (P,); None is allowed if `finds_start`."""
