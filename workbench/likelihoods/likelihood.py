"""What every likelihood offers."""

from typing import Protocol

from workbench.arrays import FloatArray
from workbench.datasets.frame import Frame


class Likelihood(Protocol):
    """log p(frame_t | pose_t, pose_t−1, frame_t−1): image motion needs the previous pose and frame too."""

    def log_prob(self, previous: Frame, frame: Frame, previous_pose: FloatArray, pose: FloatArray) -> FloatArray:
        """Log likelihoods (N,) of poses (N, P) that came from previous poses (N, P)."""

    def warnings(self) -> tuple[str, ...]:
        """Sentences about what was skipped or degraded since the last call, for the person who runs this."""
