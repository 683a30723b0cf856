"""The start of a filter from points of the person's surface: what least squares finds in the first frames."""

from collections.abc import Iterable
from dataclasses import dataclass
from itertools import takewhile

import numpy as np

from workbench.arrays import FloatArray
from workbench.body.limbs import Body
from workbench.body.skeleton import Skeleton
from workbench.body.surface import Surface, person_surface
from workbench.core.frame import Frame
from workbench.core.observation_residuals import surface_residual
from workbench.core.observations import Observables, Observed
from workbench.core.prior import Prior
from workbench.core.residual import Loss, ResidualFunction
from workbench.inference.fit.first_guess import START_LOSS, START_SIGMA_M
from workbench.inference.fit.least_squares import LeastSquares

START_S = 1.0
"""Time whose frames are looked at: which way a person faces shows in which way they go."""


@dataclass(frozen=True, eq=False)
class Distances:
    """Distances of points from a surface, as the start of least squares always looks at them."""

    skeleton: Skeleton
    surface: Surface

    @property
    def observables(self) -> Observables:
        """Points, with the deviation of the start."""
        return Observables(sigma=START_SIGMA_M)

    @property
    def residual_loss(self) -> Loss:
        """The loss of the start."""
        return START_LOSS

    def residual(self, observed: Observed) -> ResidualFunction:
        """Measure the distances, whitened by the deviation."""
        return surface_residual(self.skeleton, self.surface, observed.points, "distance", START_SIGMA_M)


def start_from_points(prior: Prior | None, body: Body, frames: Iterable[Frame]) -> FloatArray:
    """Find the pose (P,) in the first frame that the points of the first second tell.

    The prior's motion model is fitted where it has one, else smooth poses within the body's limits. Raises InputError
    where the points do not tell where the person faces.
    """
    frames = iter(frames)
    first = next(frames)
    seen = [first, *takewhile(lambda frame: frame.time_s - first.time_s <= START_S, frames)]
    distances = Distances(body.skeleton, person_surface(body))
    fit, _, _ = LeastSquares(body, distances, prior).fit_frames(seen, None, np.random.default_rng(0))
    pose: FloatArray = fit.poses[0]
    return pose
