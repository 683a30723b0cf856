"""Resampling: from weights to ancestors (Doucet, de Freitas & Gordon 2001; Douc, Cappé & Moulines 2005)."""

from collections.abc import Callable
from typing import Any

import numba
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
    positions = positions * edges[-1]
    rising = bool((positions[1:] >= positions[:-1]).all())  # as systematic ones are
    found = _walk(edges, positions) if rising else np.searchsorted(edges, positions, side="right")
    ancestors: IntArray = np.minimum(found, last)
    return ancestors


@numba.njit(cache=True, nogil=True)
def _walk(edges: Any, positions: Any) -> Any:
    """`searchsorted` from the right for rising positions, in one walk."""
    found, j = np.empty(positions.shape[0], dtype=np.int64), 0
    for i in range(positions.shape[0]):
        while j < edges.shape[0] and edges[j] <= positions[i]:
            j += 1
        found[i] = j
    return found


RESAMPLING: dict[str, Resample] = {"systematic": systematic, "multinomial": multinomial, "residual": residual}
