"""What a fit asks of a learned motion."""

from typing import Protocol

from workbench.arrays import FloatArray


class MotionModel(Protocol):
    """What a fit asks of a learned motion, C angles with d coefficients; `learning.activities.ActivityModel` is one.

    angles: the C degrees of freedom it speaks of. scales: (d,) standard deviations of the coefficients. Of the n
    examples it was learned from: scores (n, d) in units of scales, activities, and cycle_rate_hz (n,).
    """

    @property
    def angles(self) -> tuple[str, ...]: ...
    @property
    def scales(self) -> FloatArray: ...
    @property
    def scores(self) -> FloatArray: ...
    @property
    def activities(self) -> tuple[str, ...]: ...
    @property
    def cycle_rate_hz(self) -> FloatArray: ...

    def angles_at(self, alpha: FloatArray, mu: FloatArray) -> FloatArray:
        """Angles (..., C), rad, for coefficients (..., d) in units of scales at phases (...,), cycles."""

    def jacobian_at(self, alpha: FloatArray, mu: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Their derivatives (..., C, d) by the coefficients and (..., C) by the phase."""
