"""Summaries of a weighted posterior."""

import numpy as np

from workbench.arrays import FloatArray


def weighted_quantiles(values: FloatArray, weights: FloatArray, levels: tuple[float, ...]) -> FloatArray:
    """Quantiles (L, D) at `levels` of the columns of values (N, D) with normalised weights (N,).

    The q-quantile is the smallest value at which the weighted empirical distribution reaches q. np.quantile with
    method="inverted_cdf" takes 1.7 times as long and, where a sum of even weights rounds, gives the next value.
    """
    columns = np.ascontiguousarray(values.T)
    order = np.argsort(columns, axis=1)  # not the stable sort, which takes four times as long
    reached = np.cumsum(weights[order], axis=1)
    reached /= reached[:, -1:]
    ranks = np.stack([(reached < level - 1e-12).sum(axis=1) for level in levels])  # 1e-12: the sum's rounding
    every = np.arange(len(columns))
    return columns[every, order[every, ranks.clip(max=len(values) - 1)]]
