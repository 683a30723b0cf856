"""Interfaces of likelihoods: prepared once for each frame, then evaluated at poses."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Protocol

from workbench.core.frame import Frame
from workbench.utils.arrays import FloatArray


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


class Likelihood(Protocol):
    """log p(frame_t | pose_t, pose_t−1, frame_t−1): image motion also depends on the previous pose and frame."""

    def prepare(self, previous: Frame | None, frame: Frame) -> FrameLikelihood:
        """Return the likelihood of a frame, given the previous one; None for the first frame of a run, which is not
        evaluated."""
