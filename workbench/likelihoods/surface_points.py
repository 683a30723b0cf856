"""Likelihood of observed 3-D points given the body's surface: that of paper D's data, for particle filters."""

from dataclasses import dataclass
from functools import cached_property, partial
from typing import ClassVar

import numpy as np

from workbench.body.limbs import Body
from workbench.body.surface import KINDS, SHARPNESS, Kind, Surface, nearest_distances, person_surface
from workbench.core.capabilities import POINTS, RESIDUALS, Traits, component_traits
from workbench.core.checks import INSIDE_UNIT, POSITIVE, UP_TO_1, at_least, check, one_of
from workbench.core.frame import Frame
from workbench.core.losses import LOSSES, POINT_LOSS, Loss
from workbench.core.observations import Observables, Observed
from workbench.core.residual import ResidualFunction, surface_residual
from workbench.likelihoods.base import PoseFrameLikelihood, finite_rows
from workbench.utils.arrays import FloatArray

SIGMA_M = 0.02  # of a point's distance from the surface
RANGE_M = 2.0  # of an outlier's uniform distribution
_BLOCK = 2**20  # distances in memory at once, 8 MiB


@dataclass(frozen=True, eq=False)
class SurfacePoints:
    """Points scatter about the surface, or are uniform outliers (paper D has a plain sum of squares, without outliers):

        log p = likelihood_power · Σ_k log((1 − ε) N(r_k; 0, σ²) + ε / RANGE_M)

    with r_k the distance of point k to the nearest part of the body's implicit surface. Least squares instead minimises
    a robust loss of the residuals over sigma. Raises InputError if a parameter is out of range.

    Parameters
    ----------
    body : the person's body.
    sigma : σ, in the unit of `residual`.
    outlier_fraction : ε.
    likelihood_power : below 1 it flattens the posterior, since the errors of points of one stereo pair are correlated.
    residual : of least squares: "distance", m, or paper D's "field".
    sharpness : of the surface's field, a of `body.surface`.
    loss : of least squares: "squared", "huber" or "geman_mcclure".
    loss_scale : residual at which the loss bends, in the unit of `residual`.
    common_bias_std_m : standard deviation, m, along each axis, of the bias shared by the points of one body part, and
        by all points; see `least_squares.motion.shared_errors`.
    """

    traits: ClassVar[Traits] = component_traits(RESIDUALS, dataset=POINTS)

    body: Body
    sigma: float = SIGMA_M
    outlier_fraction: float = 0.15
    likelihood_power: float = 0.03
    residual: Kind = "distance"
    sharpness: float = SHARPNESS
    loss: str = POINT_LOSS.name
    loss_scale: float = POINT_LOSS.scale * SIGMA_M
    common_bias_std_m: float = 0.012

    def __post_init__(self) -> None:
        check("surface points", self, sigma=POSITIVE, outlier_fraction=INSIDE_UNIT, likelihood_power=UP_TO_1)
        check("surface points", self, residual=one_of(*KINDS), loss=one_of(*LOSSES), loss_scale=POSITIVE)
        check("surface points", self, sharpness=POSITIVE, common_bias_std_m=at_least(0))

    @property
    def observables(self) -> Observables:
        """Points, with standard deviation sigma."""
        return Observables(
            sigma=self.sigma, residual=self.residual, sharpness=self.sharpness, common_bias_std_m=self.common_bias_std_m
        )

    @property
    def residual_loss(self) -> Loss:
        """The loss of whitened residuals."""
        return Loss(self.loss, self.loss_scale / self.sigma)

    def residual_function(self, observed: Observed) -> ResidualFunction:
        """Return the residuals of the frame's points, whitened by sigma."""
        return surface_residual(self.body.skeleton, self.surface, observed.points, self.residual, self.sigma)

    @cached_property
    def surface(self) -> Surface:
        """The body's implicit surface."""
        return person_surface(self.body, self.sharpness)

    def prepare(self, previous: Frame | None, frame: Frame) -> PoseFrameLikelihood:
        """Return the likelihood of the frame's finite points; constant if there are none."""
        candidates = np.empty((0, 3)) if frame.points is None else frame.points
        points = candidates[finite_rows(candidates)]
        note = "" if len(candidates) else f"frame {frame.index}: no points"
        if n_omitted := len(candidates) - len(points):
            note = f"frame {frame.index}: {n_omitted} of {len(candidates)} points are not finite; omitted"
        log_prob = partial(self._log_prob, points)
        return PoseFrameLikelihood("surface points", log_prob, lambda expected_pose: self, (note,) if note else ())

    def _log_prob(self, points: FloatArray, pose: FloatArray) -> FloatArray:
        log_prob, n_poses = np.empty(len(pose)), max(1, _BLOCK // max(1, len(points)))
        for first in range(0, len(pose), n_poses):
            rows = slice(first, first + n_poses)
            z = nearest_distances(self.body.skeleton, self.surface, pose[rows], points) / self.sigma
            inlier = (1.0 - self.outlier_fraction) * np.exp(-0.5 * z**2) / (np.sqrt(2.0 * np.pi) * self.sigma)
            inlier = np.nan_to_num(inlier, copy=False)  # squares overflow far away
            log_prob[rows] = self.likelihood_power * np.log(inlier + self.outlier_fraction / RANGE_M).sum(axis=1)
        return log_prob
