"""Confidence intervals of means over repetitions, and weighted quantiles."""

import numpy as np
import scipy

from workbench.utils.arrays import FloatArray

N_RESAMPLES = 10_000


def bootstrap_interval(values: FloatArray, rng: np.random.Generator, level: float = 0.95) -> FloatArray:
    """Return the percentile bootstrap interval (2, ...) of the mean of values (n, ...) over their first axis.

    Efron & Tibshirani, An Introduction to the Bootstrap (1993), section 13.3. NaN for fewer than two values. It is too
    narrow for a handful of values: for three it is their range, which covers the mean of a normal distribution with
    probability 3/4. scipy.stats.bootstrap gives the same in twice the time.
    """
    n = len(values)
    if n < 2:
        return np.full((2, *values.shape[1:]), np.nan)
    means = values[rng.integers(n, size=(N_RESAMPLES, n))].mean(axis=1)
    tail = (1.0 - level) / 2.0
    return np.quantile(means, (tail, 1.0 - tail), axis=0)


def weighted_quantiles(values: FloatArray, weights: FloatArray, levels: tuple[float, ...]) -> FloatArray:
    """Return quantiles (L, D) at `levels` of the columns of values (N, D) with normalised weights (N,).

    The q-quantile is the smallest value at which the weighted empirical distribution reaches q. np.quantile with
    method="inverted_cdf" takes 1.7 times as long and, where a sum of even weights rounds, gives the next value.
    """
    columns = np.ascontiguousarray(values.T)
    order = np.argsort(columns, axis=1)  # not the stable sort, which takes four times as long
    reached = np.cumsum(weights[order], axis=1)
    reached /= reached[:, -1:]
    ranks = np.stack([(reached < level - 1e-12).sum(axis=1) for level in levels])  # 1e-12: the sum's rounding
    rows = np.arange(len(columns))
    return columns[rows, order[rows, ranks.clip(max=len(values) - 1)]]


_ROUNDING = 1e-9
"""Relative tolerance of a number that is equal for every seed."""


def mean_interval(old: FloatArray, new: FloatArray, level: float) -> float:
    """Return the largest difference of the means of `old` and `new` that is consistent with one distribution.

    It is the half-width of the interval of Student's two-sample t test. Under the hypothesis of no change both have one
    variance, so it is pooled:

        t(n + k − 2) s √(1/n + 1/k),  s² = (Σ (oldᵢ − mean)² + Σ (newⱼ − mean)²) / (n + k − 2).

    For one old number, n = 1, this is the new numbers' prediction interval for one more number. A number that is equal
    for every seed may differ by rounding only.

    Parameters
    ----------
    old : (n,), n ≥ 1.
    new : (k,), k ≥ 2, of other seeds.
    level : of the interval, such as 0.95, or 1 − 0.05 / m for m simultaneous tests (Bonferroni).
    """
    n, k = len(old), len(new)
    squares = float(((old - old.mean()) ** 2).sum() + ((new - new.mean()) ** 2).sum())
    reach = scipy.stats.t.ppf(0.5 + 0.5 * level, n + k - 2) * np.sqrt(squares / (n + k - 2) * (1.0 / n + 1.0 / k))
    return float(reach + _ROUNDING * abs(old.mean()))
