"""Log weights, and resampling: from weights to ancestors (Doucet, de Freitas & Gordon 2001; Douc, Cappé & Moulines
2005)."""

from collections.abc import Callable

import numpy as np

from workbench.core.resampling import systematic_indices
from workbench.utils.arrays import FloatArray, IntArray
from workbench.utils.errors import RunFailure


class DegenerateWeights(RunFailure):
    """No particle explains a frame, and the run was told to end there."""


def logsumexp(log_weights: FloatArray) -> float:
    """Return log Σ exp of (N,): −∞ where all are, nan where one is. scipy's, which also knows axes, signs, factors and
    complex numbers, takes four times as long for 10⁴ weights."""
    largest = float(log_weights.max())
    return largest + float(np.log(np.exp(log_weights - largest).sum())) if np.isfinite(largest) else largest


def even_log_weights(n: int) -> FloatArray:
    """Return normalised log weights (n,) of particles that count alike."""
    return np.full(n, -np.log(n))


def effective_sample_size(log_weights: FloatArray) -> float:
    """Return 1 / Σ w² of normalised log weights (N,) (Kong, Liu & Wong 1994)."""
    return float(np.exp(-logsumexp(2.0 * log_weights)))


def effective_number(picked: IntArray, log_weights: FloatArray) -> float:
    """Return the effective sample size of particles with normalised log weights (N,) when those that are copies of one
    particle, picked (N,), count as one."""
    shares = np.bincount(picked, weights=np.exp(log_weights))
    return float(1.0 / (shares**2).sum())


def drop_undefined(log_prob: FloatArray) -> tuple[FloatArray, tuple[str, ...]]:
    """Return log likelihoods (N,) with −∞ for those that are undefined, and a sentence that says so."""
    undefined = np.isnan(log_prob) | (log_prob == np.inf)
    if not undefined.any():
        return log_prob, ()
    return np.where(undefined, -np.inf, log_prob), (
        f"the likelihood of {undefined.sum()} particles is undefined; dropped",
    )


def lookahead_log_weight(log_prob: FloatArray, power: float) -> FloatArray:
    """Return log weights (N,) to choose states by that are not finished: their log likelihoods to the power `power`.
    An impossible state may lead to possible ones: it keeps the least of the finite values."""
    possible = np.isfinite(log_prob)
    floor = log_prob[possible].min() if possible.any() else 0.0
    return power * np.where(possible, log_prob, floor)


Resample = Callable[[FloatArray, np.random.Generator], IntArray]


def systematic(weights: FloatArray, rng: np.random.Generator, n: int | None = None) -> IntArray:
    """Draw rising ancestors (n,), N by default, by normalised weights (N,): one uniform, n equidistant positions."""
    return systematic_indices(weights, rng.random(), len(weights) if n is None else n)


def multinomial(weights: FloatArray, rng: np.random.Generator) -> IntArray:
    """Draw ancestors (N,) independently by their weights (N,)."""
    return _pick(weights, rng.random(len(weights)))


def residual(weights: FloatArray, rng: np.random.Generator) -> IntArray:
    """Draw ancestors (N,): ⌊N w⌋ copies of each particle, the rest independently by what is left of the weights."""
    expected = len(weights) * weights
    copies = np.floor(expected).astype(np.int64)
    rest = expected - copies
    missing = len(weights) - int(copies.sum())
    certain = np.repeat(np.arange(len(weights)), copies)
    if missing == 0:
        return certain
    return np.sort(np.concatenate([certain, _pick(rest / rest.sum(), rng.random(missing))]))


def _pick(weights: FloatArray, positions: FloatArray) -> IntArray:
    edges = np.cumsum(weights)
    last = int(np.flatnonzero(weights)[-1])  # rounding may leave the last edge short of one
    return np.minimum(np.searchsorted(edges, positions * edges[-1], side="right"), last)


RESAMPLING: dict[str, Resample] = {"systematic": systematic, "multinomial": multinomial, "residual": residual}
