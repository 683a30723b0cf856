"""Arithmetic of log weights."""

import numpy as np

from workbench.arrays import FloatArray


def logsumexp(log_weights: FloatArray) -> float:
    """log Σ exp of (N,): −∞ where all are, nan where one is.

    scipy's, which also knows axes, signs, factors and complex numbers, takes four times as long for 10⁴ weights.
    """
    largest = float(log_weights.max())
    return largest + float(np.log(np.exp(log_weights - largest).sum())) if np.isfinite(largest) else largest
