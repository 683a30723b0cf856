"""How sure a mean over a few repetitions is."""

import numpy as np
import scipy

from workbench.utils.arrays import FloatArray

N_RESAMPLES = 10_000


def bootstrap_interval(values: FloatArray, rng: np.random.Generator, level: float = 0.95) -> FloatArray:
    """Return the percentile bootstrap interval (2, ...) of the mean of values (n, ...) over their first axis.

    Efron & Tibshirani, An Introduction to the Bootstrap (1993), section 13.3. NaN for fewer than two values, which say
    nothing about their spread. It is too narrow for a handful of values: for three it is their range, within which the
    mean of a normal distribution lies three times in four. scipy.stats.bootstrap gives the same in twice the time.
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
    if len(weights) and (weights == weights[0]).all():  # the same ranks in all columns: a partition does
        shares = np.cumsum(weights)
        shares /= shares[-1]
        rows = [min(int((shares < level - 1e-12).sum()), len(values) - 1) for level in levels]
        return np.partition(columns, rows, axis=1)[:, rows].T
    order = np.argsort(columns, axis=1)  # not the stable sort, which takes four times as long
    reached = np.cumsum(weights[order], axis=1)
    reached /= reached[:, -1:]
    ranks = np.stack([(reached < level - 1e-12).sum(axis=1) for level in levels])  # 1e-12: the sum's rounding
    every = np.arange(len(columns))
    return columns[every, order[every, ranks.clip(max=len(values) - 1)]]


_ROUNDING = 1e-9  # of a number, where it is the same for every seed


def mean_interval(old: FloatArray, new: FloatArray, level: float) -> float:
    """Return how far the mean of `new` may lie from the mean of `old` when both have one distribution.

    The half-width of the interval of Student's two-sample t test. That nothing has changed is the hypothesis, under
    which both have one variance, so it is pooled:

        t(n + k − 2) s √(1/n + 1/k),  s² = (Σ (oldᵢ − mean)² + Σ (newⱼ − mean)²) / (n + k − 2).

    With one old number, n = 1, this is the new numbers' prediction interval for one more: does the old number look
    like one of them? With n > 1 old ones it asks whether the new mean lies in the interval about the old mean.
    A number that is the same for every seed may differ by rounding only.

    old: (n,), n ≥ 1. new: (k,), k ≥ 2, of other seeds. level: of the interval, such as 0.95; 1 − 0.05 / m where m
    numbers are judged at once (Bonferroni), so that all of them pass 95 % of the time.
    """
    n, k = len(old), len(new)
    squares = float(((old - old.mean()) ** 2).sum() + ((new - new.mean()) ** 2).sum())
    reach = scipy.stats.t.ppf(0.5 + 0.5 * level, n + k - 2) * np.sqrt(squares / (n + k - 2) * (1.0 / n + 1.0 / k))
    return float(reach + _ROUNDING * abs(old.mean()))
