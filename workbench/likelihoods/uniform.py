"""The likelihood that knows nothing: every pose is equally likely (paper A, fig. 7: the prior alone)."""

from typing import ClassVar

import numpy as np

from workbench.core.capabilities import UNIFORM_WEIGHTS, Traits, component_traits
from workbench.core.frame import Frame
from workbench.likelihoods.base import PoseLook


class Uniform:
    """log p = 0 whatever the images show, so that a run shows what the temporal prior does by itself."""

    traits: ClassVar[Traits] = component_traits(UNIFORM_WEIGHTS)

    def prepare(self, previous: Frame | None, frame: Frame) -> PoseLook:
        """See nothing."""
        return PoseLook("uniform", lambda pose: np.zeros(len(pose)), lambda expected_pose: self)
