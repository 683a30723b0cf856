"""Statistics that ignore NaN and, unlike NumPy's, do not warn where all values are NaN."""

import numpy as np

from workbench.utils.arrays import FloatArray


def nan_median(values: FloatArray) -> FloatArray:
    """Return the median (...) over the last axis of values (..., n), NaN where all n are."""
    ordered = np.sort(values, axis=-1)  # NaN come last
    n = np.isfinite(ordered).sum(axis=-1, keepdims=True)
    last = np.maximum(n - 1, 0)
    low, high = (np.take_along_axis(ordered, k, axis=-1) for k in (last // 2, (last + 1) // 2))
    return np.asarray((0.5 * (low + high))[..., 0])
