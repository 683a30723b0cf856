"""Whether numbers of runs that differ in their seeds come from one distribution."""

import numpy as np
from scipy import stats

from workbench.arrays import FloatArray

_ROUNDING = 1e-9  # of a number, where it is the same for every seed


def mean_interval(old: FloatArray, new: FloatArray, level: float) -> float:
    """Tell how far the mean of `new` may lie from the mean of `old` when both have one distribution.

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
    reach = stats.t.ppf(0.5 + 0.5 * level, n + k - 2) * np.sqrt(squares / (n + k - 2) * (1.0 / n + 1.0 / k))
    return float(reach + _ROUNDING * abs(old.mean()))
