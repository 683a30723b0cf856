"""The constant likelihood: every pose is equally likely (paper A, fig. 7: the prior alone)."""

from typing import ClassVar

import numpy as np

from workbench.core.capabilities import UNIFORM_WEIGHTS, Traits, component_traits
from workbench.core.frame import Frame
from workbench.likelihoods.base import PoseFrameLikelihood


class Uniform:
    """log p = 0 for all images, so that the posterior is the temporal prior."""

    traits: ClassVar[Traits] = component_traits(UNIFORM_WEIGHTS)

    def prepare(self, previous: Frame | None, frame: Frame) -> PoseFrameLikelihood:
        """Return the constant likelihood of a frame."""
        return PoseFrameLikelihood("uniform", lambda pose: np.zeros(len(pose)), lambda expected_pose: self)
