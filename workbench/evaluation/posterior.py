"""Summaries of a weighted posterior."""

import numpy as np

from workbench.arrays import FloatArray


def weighted_quantiles(values: FloatArray, weights: FloatArray, levels: tuple[float, ...]) -> FloatArray:
    """Quantiles (L, D) at `levels` of the columns of values (N, D) with normalised weights (N,).

    The q-quantile is the smallest value at which the weighted empirical distribution reaches q.
    """
    order = np.argsort(values, axis=0, kind="stable")
    ranked = np.take_along_axis(values, order, axis=0)
    reached = np.cumsum(weights[order], axis=0)
    reached /= reached[-1]
    rows = [np.argmax(reached >= min(level, 1.0) - 1e-12, axis=0) for level in levels]
    return np.stack([ranked[row, np.arange(values.shape[1])] for row in rows])
