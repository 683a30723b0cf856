"""How sure a mean over a few repetitions is."""

import numpy as np

from workbench.arrays import FloatArray

N_RESAMPLES = 10_000


def bootstrap_interval(values: FloatArray, rng: np.random.Generator, level: float = 0.95) -> FloatArray:
    """The percentile bootstrap interval (2, ...) of the mean of values (n, ...) over their first axis.

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
