"""How well limb lengths are known where nobody measured them."""

import numpy as np

from workbench.body.skeleton import Skeleton
from workbench.utils.arrays import FloatArray

TOLD_SIGMA = 0.02
"""Of a bone over its length: what a measuring tape leaves."""


def told_doubt(skeleton: Skeleton) -> FloatArray:
    """Return the doubt (J, 3, G) of a skeleton whose bones are TOLD_SIGMA of their length off, both sides alike."""
    bones = [name.removeprefix("left_").removeprefix("right_") for name in skeleton.names]
    causes = list(dict.fromkeys(bones))
    own = np.array([[bone == cause for cause in causes] for bone in bones], dtype=np.float64)
    return np.asarray(TOLD_SIGMA * skeleton.offsets[:, :, None] * own[:, None, :])
