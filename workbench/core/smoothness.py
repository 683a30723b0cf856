"""By how much a fit lets poses change from frame to frame: its penalty."""

from dataclasses import dataclass

import numpy as np

from workbench.arrays import FloatArray

PACE_HZ = 14.0
"""The frames a second for which `Smoothness` is given, paper D's."""


@dataclass(frozen=True)
class Smoothness:
    """Standard deviations of what may change between frames at PACE_HZ; over other times as a random walk of the
    coefficients and of the speeds.

    style: the part of a coefficient that is new in every frame, in standard deviations of the model. phase: second
    differences of μ, cycles. position, rotation: second differences of the root, m and rad. angle: those of joint
    angles without a motion model, rad.
    """

    style: float = 0.3
    phase: float = 0.02
    position: float = 0.03
    rotation: float = 0.03
    angle: float = 0.2

    @property
    def second_differences(self) -> FloatArray:
        """(7,), of {μ, root}."""
        return np.array([self.phase, *[self.position] * 3, *[self.rotation] * 3])
