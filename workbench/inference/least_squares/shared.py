"""What many observations are off by together, which more of them do not average out."""

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
class Shared:
    """Displacements d of the points of each part of the body, and of all points, in every frame the same:

        x_tk = surface + noise + d_part(k) + d_all,  d ~ N(0, sigma_m² I)

    A part is off where the person's proportions, flesh or clothes are others than told; all are where the camera is.
    part: frame by frame, from a pose (P,) to the parts (K,) of its points. n_parts: of the body.
    """

    sigma_m: float
    part: Sequence[Callable[[FloatArray], IntArray]]
    n_parts: int

    @staticmethod
    def of_points(skeleton: Skeleton, surface: Surface, seen: Sequence[Observed], sigma_m: float) -> "Shared":
        """Share errors among the points that are nearest to one part of the surface."""

        def parts_of(points: FloatArray) -> Callable[[FloatArray], IntArray]:
            return lambda pose: attach(surface, forward(skeleton, pose[None]), points)

        return Shared(sigma_m, [parts_of(frame.points) for frame in seen], len(surface.part_names))

    def shifts(self, t: int, slopes: FloatArray, pose: FloatArray) -> FloatArray:
        """Tell by how much one deviation of each displacement changes the residuals of frame t at a pose (P,), (K, 3
        parts + 3). slopes: (K, P), of the residuals; points that move are a root that moves the other way."""
        parts = self.part[t](pose)
        moved = -self.sigma_m * slopes[: len(parts), :N_POSITION]  # points come first
        found = np.zeros((len(slopes), self.n_parts + 1, N_POSITION))
        found[np.arange(len(parts)), parts] = moved
        found[: len(parts), -1] = moved
        return found.reshape(len(slopes), N_POSITION * (self.n_parts + 1))
