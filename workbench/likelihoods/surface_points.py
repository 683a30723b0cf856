"""How well a body's surface explains observed points: the likelihood of paper D's data for a particle filter."""

from dataclasses import dataclass
from functools import cached_property, partial
from typing import ClassVar

import numpy as np

from workbench.body.limbs import Body
from workbench.body.surface import KINDS, Kind, Surface, nearest_distances, person_surface
from workbench.core.capabilities import POINTS, RESIDUALS, Traits, offering
from workbench.core.checks import INSIDE_UNIT, POSITIVE, UP_TO_1, at_least, check, one_of
from workbench.core.frame import Frame
from workbench.core.observations import Observables, Observed
from workbench.core.residual import LOSSES, Loss, ResidualFunction, surface_residual
from workbench.likelihoods.base import PoseLook, finite_rows
from workbench.utils.arrays import FloatArray

RANGE_M = 2.0  # over which an outlier may lie
_BLOCK = 2**20  # distances that are held at once, 8 MiB


@dataclass(frozen=True, eq=False)
class SurfacePoints:
    """Points lie about the surface, or anywhere (paper D has the plain sum of squares, which knows no outliers):

        log p = temper · Σ_k log((1 − ε) N(r_k; 0, σ²) + ε / RANGE_M)

    with r_k the distance of point k to the nearest part of the body's implicit surface. sigma: σ, m. epsilon: ε, the
    share of outliers. temper: below 1 flattens the posterior, since points of one stereo pair err together.

    Least squares minimises the residuals over sigma instead, of this kind, "distance" (m) or the paper's "field", under
    a loss, "squared", "huber" or "geman_mcclure", which bends at `scale`; sigma and scale are then in the kind's unit.
    common_bias_std_m: m, deviation along each axis of what points of one part of the body, and all, are off together,
    see `systematic_errors.Shared`. Raises InputError when a constant is out of range."""

    traits: ClassVar[Traits] = offering(RESIDUALS, dataset=POINTS)

    body: Body
    sigma: float = 0.02
    outlier_fraction: float = 0.15
    likelihood_power: float = 0.03
    residual: Kind = "distance"
    loss: str = "geman_mcclure"
    loss_scale: float = 0.03
    common_bias_std_m: float = 0.012

    def __post_init__(self) -> None:
        check("surface points", self, sigma=POSITIVE, outlier_fraction=INSIDE_UNIT, likelihood_power=UP_TO_1)
        check("surface points", self, residual=one_of(*KINDS), loss=one_of(*LOSSES), loss_scale=POSITIVE)
        check("surface points", self, common_bias_std_m=at_least(0))

    @property
    def observables(self) -> Observables:
        """Points, with the deviation sigma."""
        return Observables(sigma=self.sigma, residual=self.residual, common_bias_std_m=self.common_bias_std_m)

    @property
    def residual_loss(self) -> Loss:
        """The loss of whitened residuals."""
        return Loss(self.loss, self.loss_scale / self.sigma)

    def residual_function(self, observed: Observed) -> ResidualFunction:
        """Measure the residuals of the frame's points, whitened by sigma."""
        return surface_residual(self.body.skeleton, self.surface, observed.points, self.residual, self.sigma)

    @cached_property
    def surface(self) -> Surface:
        """The body's implicit surface."""
        return person_surface(self.body)

    def prepare(self, previous: Frame | None, frame: Frame) -> PoseLook:
        """Pick out the finite points; poses are all equally likely where there are none."""
        given = np.empty((0, 3)) if frame.points is None else frame.points
        points = given[finite_rows(given)]
        note = "" if len(given) else f"frame {frame.index}: there are no points"
        if lost := len(given) - len(points):
            note = f"frame {frame.index}: {lost} of {len(given)} points are not finite; left out"
        judge = partial(self._log_prob, points)
        return PoseLook("surface points", judge, lambda expected_pose: self, (note,) if note else ())

    def _log_prob(self, points: FloatArray, pose: FloatArray) -> FloatArray:
        log_prob, together = np.empty(len(pose)), max(1, _BLOCK // max(1, len(points)))
        for first in range(0, len(pose), together):
            rows = slice(first, first + together)
            z = nearest_distances(self.body.skeleton, self.surface, pose[rows], points) / self.sigma
            near = (1.0 - self.outlier_fraction) * np.exp(-0.5 * z**2) / (np.sqrt(2.0 * np.pi) * self.sigma)
            near = np.nan_to_num(near, copy=False)  # whose squares overflow is far away
            log_prob[rows] = self.likelihood_power * np.log(near + self.outlier_fraction / RANGE_M).sum(axis=1)
        return log_prob
