"""What every likelihood offers, and what some offer besides."""

from collections.abc import Mapping
from typing import Protocol, runtime_checkable

from workbench.arrays import FloatArray
from workbench.datasets.frame import Frame


class Likelihood(Protocol):
    """log p(frame_t | pose_t, pose_t−1, frame_t−1): image motion needs the previous pose and frame too."""

    def log_prob(self, previous: Frame, frame: Frame, previous_pose: FloatArray, pose: FloatArray) -> FloatArray:
        """Log likelihoods (N,) of poses (N, P) that came from previous poses (N, P)."""

    def warnings(self) -> tuple[str, ...]:
        """Sentences about what was skipped or degraded since the last call, for the person who runs this."""


@runtime_checkable
class Remembering(Protocol):
    """A likelihood with a memory, such as of how the person looks: an inference tells it every frame's result."""

    def begin(self, frame: Frame, pose: FloatArray) -> None:
        """Forget what was, and learn from the first frame of a run and its expected pose (P,)."""

    def observe(self, frame: Frame, pose: FloatArray) -> None:
        """Take in a later frame and the expected pose (P,) that was found in it."""


@runtime_checkable
class Accounting(Protocol):
    """A likelihood that can say more about the last frame than its value."""

    def diagnostics(self) -> Mapping[str, float]:
        """Scalars about the last `log_prob`, by name."""


def remember(likelihood: Likelihood, frame: Frame, pose: FloatArray, first: bool) -> None:
    """Tell a likelihood that has a memory the expected pose (P,) of a frame, the run's first or a later one."""
    if isinstance(likelihood, Remembering):
        (likelihood.begin if first else likelihood.observe)(frame, pose)


def diagnostics(likelihood: Likelihood) -> Mapping[str, float]:
    """What a likelihood has to say about its last `log_prob`; nothing, unless it is `Accounting`."""
    return likelihood.diagnostics() if isinstance(likelihood, Accounting) else {}
