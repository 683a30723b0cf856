"""Robust losses of least squares, and their scales.

A robust loss maps z = residual / scale to ρ(z) and the weight ρ'(z) / z, for iteratively reweighted least squares
(Holland & Welsch 1977). All losses are ½ z² with weight 1 near zero and differ only for large residuals; paper D uses
the squared loss alone. Kernels call `rho_and_weight` for one residual, functions in NumPy call a `Loss` for many.
"""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from types import MappingProxyType
from typing import Any

import numpy as np

from workbench.utils.arrays import FloatArray
from workbench.utils.errors import InputError
from workbench.utils.kernel_cache import kernel

LOSSES: Mapping[str, int] = MappingProxyType({"squared": 0, "huber": 1, "geman_mcclure": 2})
"""Names of the losses, and their codes in kernels."""
_HUBER, _GEMAN_MCCLURE = LOSSES["huber"], LOSSES["geman_mcclure"]


@kernel(no_cpython_wrapper=True, no_cfunc_wrapper=True)
def rho_and_weight(z: Any, code: Any) -> Any:
    """Return ρ(z) and the weight of a loss by its code, for one scaled residual.

    Squared: ½ z²; a single outlier dominates the cost. Huber's: ½ z² up to |z| = 1, |z| − ½ beyond; the influence of an
    outlier is bounded (Huber 1964). Geman and McClure's: ½ z² / (1 + z²); redescending, outliers have no influence
    (Geman & McClure 1987).
    """
    if code == _HUBER:
        size = abs(z)
        return (0.5 * z * z, 1.0) if size <= 1.0 else (size - 0.5, 1.0 / size)
    if code == _GEMAN_MCCLURE:
        reciprocal = 1.0 / (1.0 + z * z)
        return 0.5 * (1.0 - reciprocal), reciprocal * reciprocal
    return 0.5 * z * z, 1.0


@kernel()
def _evaluate(z: Any, code: Any, rho: Any, weights: Any) -> None:
    """Write ρ (K,) and weights (K,) of scaled residuals z (K,)."""
    for k in range(len(z)):
        rho[k], weights[k] = rho_and_weight(z[k], code)


@dataclass(frozen=True)
class Loss:
    """A robust loss of whitened residuals.

    Parameters
    ----------
    name : one of LOSSES.
    scale : residual at which the loss departs from ½ r², in standard deviations.

    Raises
    ------
    InputError : an unknown name, or a scale that is not positive.
    """

    name: str
    scale: float

    def __post_init__(self) -> None:
        if self.name not in LOSSES:
            raise InputError(f"loss must be one of {', '.join(LOSSES)}, found {self.name!r}")
        if not 0.0 < self.scale < np.inf:
            raise InputError(f"loss: scale must be above zero, found {self.scale}")

    def __call__(self, residuals: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return ρ and weights (...) of residuals (...); ρ is ½ r² near zero for every scale."""
        z = np.ascontiguousarray(residuals / self.scale)
        rho, weights = np.empty(z.shape), np.empty(z.shape)
        _evaluate(z.ravel(), LOSSES[self.name], rho.ravel(), weights.ravel())
        return self.scale**2 * rho, weights

    @property
    def redescends(self) -> bool:
        """Whether an outlier's influence decreases with its distance."""
        return LOSSES[self.name] == _GEMAN_MCCLURE

    def widened(self, factor: float) -> "Loss":
        """Return this loss with its scale multiplied by `factor`."""
        return replace(self, scale=factor * self.scale)


SQUARED = Loss("squared", 1.0)
KEYPOINT_LOSS = Loss("geman_mcclure", 1.5)
"""Of keypoints, by default: redescending, because a detector confuses joints."""
SEARCH_LOSS = Loss("huber", 3.0)
"""Of an initial search by keypoints: not redescending, because an arm lost in one frame would be an outlier in all
following ones."""
KEYPOINT_TRAJECTORY_LOSS = Loss("huber", 1.5)
"""Of keypoints in the fit of a whole body's motion of which only some joints are tracked: not redescending, because
joints are labelled."""
POINT_LOSS = Loss("geman_mcclure", 1.5)
"""Of points on the body's surface, by default, and in an initial search: redescending, because of points of other
objects."""
BALANCE_LOSS = Loss("huber", 1.0)
"""Of the centre of mass: robust, because people who jump or lean on something are out of balance."""
GROUND_LOSS = Loss("huber", 2.0)
"""Of the lower foot's height: robust, because people jump, and there are steps."""
FOOT_DRIFT_LOSS = Loss("huber", 2.0)
"""Of a foot in contact: robust, because a foot that moves straight towards the camera also seems at rest."""
DEPTH_LOSS = Loss("huber", 1.0)
"""Of a bone less deep than by its landmarks: the influence of a wrong sign is bounded."""

BEHIND = 1e3
"""Residual of a keypoint whose joint is behind the camera, in standard deviations."""
DEGREES_OF_FREEDOM = 4.0
"""Degrees of freedom of Student's t distribution, the density of keypoints; few give heavy tails, for confused
joints."""
