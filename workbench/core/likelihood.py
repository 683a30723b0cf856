"""What every likelihood offers: it looks at a frame once, and then judges poses."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Protocol

from workbench.arrays import FloatArray
from workbench.core.frame import Frame


@dataclass(frozen=True, eq=False)
class Evaluation:
    """Log likelihoods (N,) of N poses. notes: sentences about what was skipped or degraded, for the person who runs
    this. diagnostics: scalars worth a curve, by name."""

    log_prob: FloatArray
    notes: tuple[str, ...] = ()
    diagnostics: Mapping[str, float] = field(default_factory=dict)


class Look(Protocol):
    """A likelihood that has seen one frame: all that depends on the images alone is done.

    notes: sentences about the frame itself, such as that it shows nothing to judge by. diagnostics: the names that
    evaluations come with, and their values where nothing is evaluated, as in a first frame.
    """

    @property
    def notes(self) -> tuple[str, ...]: ...
    @property
    def diagnostics(self) -> Mapping[str, float]: ...

    def evaluate(self, previous_pose: FloatArray, pose: FloatArray) -> Evaluation:
        """Return log p(frame_t | pose_t, pose_t−1, frame_t−1) of poses (N, P) that came from previous poses (N, P)."""

    def remember(self, expected_pose: FloatArray) -> "Likelihood":
        """Return the likelihood of the next frame, which knows what was expected (P,) in this one."""


class Likelihood(Protocol):
    """log p(frame_t | pose_t, pose_t−1, frame_t−1): image motion needs the previous pose and frame too."""

    def look(self, previous: Frame | None, frame: Frame) -> Look:
        """Look at a frame and the one before, None for the first of a run, in which nothing is evaluated."""
