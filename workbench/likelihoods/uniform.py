"""The likelihood that knows nothing: every pose is equally likely (paper A, fig. 7: the prior alone)."""

import numpy as np

from workbench.arrays import FloatArray
from workbench.datasets.frame import Frame


class Uniform:
    """log p = 0 whatever the images show, so that a run shows what the temporal prior does by itself."""

    def log_prob(self, previous: Frame, frame: Frame, previous_pose: FloatArray, pose: FloatArray) -> FloatArray:
        """Zeros (N,) for poses (N, P)."""
        return np.zeros(len(pose))

    def warnings(self) -> tuple[str, ...]:
        """Nothing is ever skipped."""
        return ()
