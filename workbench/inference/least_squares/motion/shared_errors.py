"""Displacements of the points of body parts, shared by all frames, which do not average out."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from workbench.body.kinematics import forward
from workbench.body.skeleton import Skeleton
from workbench.body.surface import Surface, attach
from workbench.core.observations import Observed
from workbench.utils.arrays import FloatArray, IntArray

N_POSITION = 3


@dataclass(frozen=True, eq=False)
class SharedErrors:
    """Displacements d of the points of each body part, and of all points, constant over the frames:

        x_tk = surface + noise + d_part(k) + d_all,  d ~ N(0, sigma_m² I)

    Wrong proportions, flesh or clothes displace a part; a wrong camera displaces all points. part: one function per
    frame, from a pose (P,) to the body parts (K,) of its points. n_parts: number of body parts.
    """

    sigma_m: float
    part: Sequence[Callable[[FloatArray], IntArray]]
    n_parts: int

    @staticmethod
    def of_points(
        skeleton: Skeleton, surface: Surface, observations: Sequence[Observed], sigma_m: float
    ) -> "SharedErrors":
        """Return the errors shared by the points nearest to one part of the surface."""

        def associate(points: FloatArray) -> Callable[[FloatArray], IntArray]:
            return lambda pose: attach(surface, forward(skeleton, pose[None]), points)

        return SharedErrors(sigma_m, [associate(frame.points) for frame in observations], len(surface.part_names))

    def residual_changes(self, t: int, jacobian: FloatArray, pose: FloatArray) -> FloatArray:
        """Return the changes (K, 3 n_parts + 3) of frame t's residuals at a pose (P,) for one standard deviation of
        each displacement. jacobian: (K, P), of the residuals; a displacement of the points acts as the opposite one of
        the root."""
        parts = self.part[t](pose)
        moved = -self.sigma_m * jacobian[: len(parts), :N_POSITION]  # points come first
        changes = np.zeros((len(jacobian), self.n_parts + 1, N_POSITION))
        changes[np.arange(len(parts)), parts] = moved
        changes[: len(parts), -1] = moved
        return changes.reshape(len(jacobian), N_POSITION * (self.n_parts + 1))
