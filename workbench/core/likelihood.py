"""What every likelihood offers: it looks at a frame once, and then judges poses."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Protocol, runtime_checkable

from workbench.core.frame import Frame
from workbench.utils.arrays import BoolArray, FloatArray


@dataclass(frozen=True, eq=False)
class Evaluation:
    """Log likelihoods (N,) of N poses. notes: sentences about what was skipped or degraded, for the person who runs
    this. diagnostics: scalars worth a curve, by name."""

    log_prob: FloatArray
    notes: tuple[str, ...] = ()
    diagnostics: Mapping[str, float] = field(default_factory=dict)


class FrameLikelihood(Protocol):
    """A likelihood that has seen one frame: all that depends on the images alone is done.

    notes: sentences about the frame itself, such as that it shows nothing to judge by. diagnostics: the names that
    evaluations come with, and their values where nothing is evaluated, as in a first frame.
    """

    @property
    def notes(self) -> tuple[str, ...]: ...
    @property
    def diagnostics(self) -> Mapping[str, float]: ...

    def evaluate(self, previous_pose: FloatArray, pose: FloatArray) -> Evaluation:
        """Return log p(frame_t | pose_t, pose_t−1, frame_t−1) of poses (N, P) that came from previous poses (N, P),
        which are lent: their memory is used again."""

    def update(self, expected_pose: FloatArray) -> "Likelihood":
        """Return the likelihood of the next frame, which knows what was expected (P,) in this one."""


@dataclass(frozen=True, eq=False)
class Slope:
    """A log likelihood at one pose of P numbers, with its gradient (P,) and the curvature (P, P) downwards, which is
    negative in no direction."""

    log_prob: float
    gradient: FloatArray
    curvature: FloatArray


@runtime_checkable
class DifferentiableLikelihood(FrameLikelihood, Protocol):
    """A look that knows how the likelihood changes with the pose, and smooths the image more or less for it.

    levels: of smoothing, the first being the smoothest. `evaluate` judges at the last. judges: whether anything is
    known to judge by, as in a first frame it may not be.
    """

    @property
    def levels(self) -> int: ...
    @property
    def informative(self) -> bool: ...

    def slope(self, pose: FloatArray, level: int) -> Slope:
        """Return log likelihood and derivatives at a pose (P,), which came from any other."""

    def misfit(self, pose: FloatArray) -> FloatArray:
        """Return how badly what every joint (J,) moves fits the image at a pose (P,): the mean loss of its points."""


@runtime_checkable
class DenseLikelihood(DifferentiableLikelihood, Protocol):
    """A sloped look that can also tell apart poses that are far from each other, by all pixels of the frame."""

    def compare(self, poses: FloatArray, moved: BoolArray) -> FloatArray:
        """Return by how much (N,) likelier the frame is in poses (N, P), which differ in what hangs on the joints
        `moved` (J,) alone, than without that, nats."""


class Likelihood(Protocol):
    """log p(frame_t | pose_t, pose_t−1, frame_t−1): image motion needs the previous pose and frame too."""

    def prepare(self, previous: Frame | None, frame: Frame) -> FrameLikelihood:
        """Look at a frame and the one before, None for the first of a run, in which nothing is evaluated."""


@runtime_checkable
class Refittable(Protocol):
    """A likelihood that learns from a clip, and more so when it has been tracked before."""

    def refitted(self, frame: Frame, poses: Mapping[int, FloatArray]) -> Likelihood:
        """Return the likelihood of the same clip, from `frame` on, which knows poses (P,) by its frames' indices."""
