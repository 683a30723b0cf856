"""Estimates of measures with 90 % intervals, from the measure of the expected motion and of samples of the motion."""

import numpy as np

from workbench.utils.arrays import FloatArray

_Z90 = 1.6449
"""95 % quantile of the normal distribution."""
MIN_SAMPLES = 10
"""Fewest samples of the motion for an interval: the standard deviation of ten has a standard error of a quarter."""


def bands_of(values: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return estimates and the bounds (...) of their 90 % intervals from values (M, ...) in M motions.

    Motion 0 is the expected motion, whose value is the estimate; the others are samples of the posterior. The interval
    is the estimate ± 1.645 times the root mean square deviation of the samples from it, which is the posterior's
    standard error of the estimate. Quantiles of 40 samples would vary by twice as much, and need not contain the
    estimate. NaN for fewer than MIN_SAMPLES samples.
    """
    value, deviations = values[0], values[1:] - values[0]
    n = np.isfinite(deviations).sum(axis=0)
    squares = np.square(np.where(np.isfinite(deviations), deviations, 0.0)).sum(axis=0)
    reach = np.where(n >= MIN_SAMPLES, _Z90 * np.sqrt(squares / np.maximum(n, 1)), np.nan)
    return value, value - reach, value + reach


def expected_extremes(values: FloatArray) -> FloatArray:
    """Return extremes (M, ...) in M motions, such as ranges, with the mean of the samples' in place of the expected
    motion's, for at least MIN_SAMPLES samples.

    The expected motion is the mean of motions whose extremes differ in size and time: its range is below their mean.
    """
    if len(values) <= MIN_SAMPLES:
        return values
    return np.concatenate([values[1:].mean(axis=0, keepdims=True), values[1:]])
