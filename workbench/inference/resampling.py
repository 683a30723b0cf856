"""Resampling: from weights to ancestors (Doucet, de Freitas & Gordon 2001; Douc, Cappé & Moulines 2005)."""

from collections.abc import Callable

import numpy as np

from workbench.arrays import FloatArray, IntArray

Resample = Callable[[FloatArray, np.random.Generator], IntArray]


def systematic(weights: FloatArray, rng: np.random.Generator) -> IntArray:
    """Ancestors (N,) of N particles with normalised weights (N,): one uniform, N equidistant positions."""
    return systematic_draws(weights, len(weights), rng)


def systematic_draws(weights: FloatArray, n: int, rng: np.random.Generator) -> IntArray:
    """Indices (n,) of particles with normalised weights (N,), in rising order: as `systematic`, but n of them."""
    positions = (np.arange(n) + rng.random()) / n
    return _pick(weights, positions)


def multinomial(weights: FloatArray, rng: np.random.Generator) -> IntArray:
    """Ancestors (N,) drawn independently by their weights (N,)."""
    return _pick(weights, rng.random(len(weights)))


def residual(weights: FloatArray, rng: np.random.Generator) -> IntArray:
    """Ancestors (N,): ⌊N w⌋ copies of each particle, the rest drawn independently by what is left of the weights."""
    expected = len(weights) * weights
    copies = np.floor(expected).astype(np.int64)
    left = expected - copies
    missing = len(weights) - int(copies.sum())
    certain = np.repeat(np.arange(len(weights)), copies)
    if missing == 0:
        return certain
    return np.sort(np.concatenate([certain, _pick(left / left.sum(), rng.random(missing))]))


def _pick(weights: FloatArray, positions: FloatArray) -> IntArray:
    edges = np.cumsum(weights)
    last = int(np.flatnonzero(weights)[-1])  # rounding may leave the last edge short of one
    ancestors: IntArray = np.minimum(np.searchsorted(edges, positions * edges[-1], side="right"), last)
    return ancestors


RESAMPLING: dict[str, Resample] = {"systematic": systematic, "multinomial": multinomial, "residual": residual}
