"""Arithmetic of log weights."""

import numpy as np

from workbench.arrays import FloatArray, IntArray


class DegenerateWeights(RuntimeError):  # noqa: N818 - the field's own term
    """No particle explains a frame, and the run was told to end there."""


def logsumexp(log_weights: FloatArray) -> float:
    """log Σ exp of (N,): −∞ where all are, nan where one is.

    scipy's, which also knows axes, signs, factors and complex numbers, takes four times as long for 10⁴ weights.
    """
    largest = float(log_weights.max())
    return largest + float(np.log(np.exp(log_weights - largest).sum())) if np.isfinite(largest) else largest


def even_log_weights(n: int) -> FloatArray:
    """Normalised log weights (n,) of particles that count alike."""
    return np.full(n, -np.log(n))


def effective_sample_size(log_weights: FloatArray) -> float:
    """1 / Σ w² of normalised log weights (N,) (Kong, Liu & Wong 1994)."""
    return float(np.exp(-logsumexp(2.0 * log_weights)))


def effective_number(picked: IntArray, log_weights: FloatArray) -> float:
    """The effective sample size of particles with normalised log weights (N,) when those that are copies of one
    particle, picked (N,), count as one."""
    shares = np.bincount(picked, weights=np.exp(log_weights))
    return float(1.0 / (shares**2).sum())


def drop_undefined(log_prob: FloatArray) -> tuple[FloatArray, tuple[str, ...]]:
    """Log likelihoods (N,) with −∞ for those that are undefined, and a sentence that says so."""
    undefined = np.isnan(log_prob) | (log_prob == np.inf)
    if not undefined.any():
        return log_prob, ()
    return np.where(undefined, -np.inf, log_prob), (
        f"the likelihood of {undefined.sum()} particles is undefined; dropped",
    )


def lookahead_log_weight(log_prob: FloatArray, flatten: float) -> FloatArray:
    """Log weights (N,) to choose states by that are not finished: their log likelihoods to the power `flatten`.

    An impossible state may lead to possible ones: it keeps the least of the finite values.
    """
    possible = np.isfinite(log_prob)
    floor = log_prob[possible].min() if possible.any() else 0.0
    log_weight: FloatArray = flatten * np.where(possible, log_prob, floor)
    return log_weight
