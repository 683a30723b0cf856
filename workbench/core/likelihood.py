"""Interfaces of likelihoods: prepared once for each frame, then evaluated at poses."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Protocol, runtime_checkable

from workbench.core.frame import Frame
from workbench.utils.arrays import BoolArray, FloatArray


@dataclass(frozen=True, eq=False)
class Evaluation:
    """Log likelihoods (N,) of N poses. notes: messages to the user about skipped or degraded computations. diagnostics:
    scalars to plot, by name."""

    log_prob: FloatArray
    notes: tuple[str, ...] = ()
    diagnostics: Mapping[str, float] = field(default_factory=dict)


class FrameLikelihood(Protocol):
    """A likelihood prepared for one frame: all computations that depend on the images alone are done. notes: messages
    about the frame itself, for example that it has no usable observations. diagnostics: the names of the diagnostics of
    evaluations, with their values where nothing is evaluated, as in a first frame."""

    @property
    def notes(self) -> tuple[str, ...]: ...
    @property
    def diagnostics(self) -> Mapping[str, float]: ...

    def evaluate(self, previous_pose: FloatArray, pose: FloatArray) -> Evaluation:
        """Return log p(frame_t | pose_t, pose_t−1, frame_t−1) of poses (N, P) with previous poses (N, P). The arrays
        are the caller's buffers and are overwritten later; copy what must persist."""

    def update(self, expected_pose: FloatArray) -> "Likelihood":
        """Return the likelihood of the next frame, updated with this frame's expected pose (P,)."""


@dataclass(frozen=True, eq=False)
class Derivatives:
    """A log likelihood at one pose of P numbers, its gradient (P,), and its negative curvature (P, P), which is
    positive semi-definite."""

    log_prob: float
    gradient: FloatArray
    curvature: FloatArray


@runtime_checkable
class DifferentiableLikelihood(FrameLikelihood, Protocol):
    """A frame likelihood with derivatives, at several levels of an image pyramid. n_levels: of smoothing; level 0 is
    the smoothest, and `evaluate` uses the last. informative: whether the likelihood depends on the pose; false for
    example in a first frame."""

    @property
    def n_levels(self) -> int: ...
    @property
    def informative(self) -> bool: ...

    def derivatives(self, pose: FloatArray, level: int) -> Derivatives:
        """Return the log likelihood and its derivatives at a pose (P,); the previous pose has no influence."""

    def mean_loss(self, pose: FloatArray) -> FloatArray:
        """Return the mean loss (J,) of the image points that each joint moves, at a pose (P,)."""


@runtime_checkable
class DenseLikelihood(DifferentiableLikelihood, Protocol):
    """A differentiable likelihood that also compares distant poses, by all pixels of the frame."""

    def compare(self, poses: FloatArray, moved: BoolArray) -> FloatArray:
        """Return the log likelihood ratios (N,), nats, of rendering and omitting the body parts on joints `moved` (J,).
        poses: (N, P), which may differ only in these body parts."""


class Likelihood(Protocol):
    """log p(frame_t | pose_t, pose_t−1, frame_t−1): image motion also depends on the previous pose and frame."""

    def prepare(self, previous: Frame | None, frame: Frame) -> FrameLikelihood:
        """Return the likelihood of a frame, given the previous one; None for the first frame of a run, which is not
        evaluated."""


@runtime_checkable
class Refittable(Protocol):
    """A likelihood that learns from a sequence, and can be learned again from tracked poses."""

    def refitted(self, frame: Frame, poses: Mapping[int, FloatArray]) -> Likelihood:
        """Return the likelihood of the same sequence, from `frame` on, learned from poses (P,) by frame index."""
