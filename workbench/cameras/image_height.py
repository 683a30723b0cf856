"""The height of a person in an image, by which errors and tolerances in pixels are measured."""

import numpy as np

from workbench.utils.arrays import FloatArray


def height_px(pixels: FloatArray) -> FloatArray:
    """Return a person's height in the image, (...), px: the longer side of the box around joints (..., J, 2).

    The longer side is the height of an upright person as well as of one who lies. Joints that are NaN are ignored; the
    height is 0 for fewer than two joints. The unit is that of the joints.
    """
    known = np.isfinite(pixels).all(axis=-1, keepdims=True)
    low = np.where(known, pixels, np.inf).min(axis=-2, initial=np.inf)
    high = np.where(known, pixels, -np.inf).max(axis=-2, initial=-np.inf)
    return np.maximum((high - low).max(axis=-1), 0.0)
