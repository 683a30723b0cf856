"""Statistics that ignore NaN and, unlike NumPy's, do not warn where all values are NaN."""

import numpy as np

from workbench.utils.arrays import FloatArray


def nan_mean(values: FloatArray, axis: int = -1) -> FloatArray:
    """Return the mean of values over an axis, NaN where all are, or none is."""
    known = np.isfinite(values)
    n = known.sum(axis=axis)
    return np.where(n > 0, np.where(known, values, 0.0).sum(axis=axis) / np.maximum(n, 1), np.nan)


def nan_median(values: FloatArray, axis: int = -1) -> FloatArray:
    """Return the median of values over an axis, NaN where all are, or none is."""
    values = np.moveaxis(values, axis, -1)
    if not values.shape[-1]:
        return np.full(values.shape[:-1], np.nan)
    ordered = np.sort(values, axis=-1)  # NaN come last
    n = np.isfinite(ordered).sum(axis=-1, keepdims=True)
    last = np.maximum(n - 1, 0)
    low, high = (np.take_along_axis(ordered, k, axis=-1) for k in (last // 2, (last + 1) // 2))
    return np.asarray((0.5 * (low + high))[..., 0])
