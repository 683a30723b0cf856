"""What a fit makes of a person whose limbs are not as long as told, which more frames do not average out."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from workbench.body.kinematics import length_jacobian
from workbench.body.skeleton import Skeleton
from workbench.core.observations import Observed
from workbench.utils.arrays import FloatArray

TOLD_SIGMA = 0.02
"""Of a bone over its length, where nobody says how well it is known: what a measuring tape leaves."""


@dataclass(frozen=True, eq=False)
class Lengths:
    """Keypoints of joints that lie elsewhere in every frame, as the skeleton's offsets are off. seen: by the frames.
    doubt: (J, 3, G), see `Body.length_doubt`."""

    skeleton: Skeleton
    seen: Sequence[Observed]
    doubt: FloatArray

    def shifts(self, t: int, slopes: FloatArray, pose: FloatArray) -> FloatArray:
        """Tell by how much one deviation of each cause changes the residuals of frame t at a pose (P,), (K, G). slopes:
        (K, P), of the residuals, of which keypoints come first; a joint that moves is a root that moves for it alone.

        Deviation: balance and the height of the floor shift, too, which is left out: the feet tell the floor.
        """
        found = np.zeros((len(slopes), self.doubt.shape[2]))
        if views := self.seen[t].keypoints:
            rows = np.concatenate([np.repeat(view.joints, 2) for view in views])
            moved = length_jacobian(self.skeleton, self.doubt, pose[None])[0, rows]
            found[: len(rows)] = np.einsum("kx,kxg->kg", slopes[: len(rows), :3], moved)
        return found


def told_doubt(skeleton: Skeleton) -> FloatArray:
    """Return the doubt (J, 3, G) of a skeleton whose bones are TOLD_SIGMA of their length off, both sides alike."""
    bones = [name.removeprefix("left_").removeprefix("right_") for name in skeleton.names]
    causes = list(dict.fromkeys(bones))
    own = np.array([[bone == cause for cause in causes] for bone in bones], dtype=np.float64)
    return np.asarray(TOLD_SIGMA * skeleton.offsets[:, :, None] * own[:, None, :])
