"""Calibration of a posterior of weighted particles: coverage, ranks, and proper scores.

values: (N, D) of N particles; weights: (N,), normalised; truth: (D,). Every function returns one number for each of the
D quantities, in their units. For particles from the true posterior the coverage is the interval's level, ranks are
uniform, and the scores, which are proper, have the smallest expectation (Gneiting & Raftery, JASA 102, 2007).
"""

from typing import Any

import numpy as np

from workbench.body.simd_kinematics import inlined_exactly
from workbench.utils.arrays import BoolArray, FloatArray, IntArray
from workbench.utils.kernel_cache import kernel
from workbench.utils.parallel import parallel_for

_ROUNDING = 1e-12
"""Rounding error of a sum of weights."""
_MIN_VALUES = 20_000
"""Numbers from which on a thread pays: starting it takes as long as some ten thousand of them."""


def covered(weights_below: FloatArray, levels: tuple[float, ...]) -> BoolArray:
    """Return whether the truth lies in the central credible intervals of the levels, (L, D).

    The interval of level 0.9 is from the 5 % to the 95 % quantile of `intervals.weighted_quantiles`. weights_below: (2,
    D), see `weight_below`, from which it follows without sorting.
    """
    below, equal = weights_below
    tails = 0.5 - 0.5 * np.array(levels)[:, None]
    return (below + equal >= tails - _ROUNDING) & (below < 1.0 - tails - _ROUNDING)


def ranks(weights_below: FloatArray) -> FloatArray:
    """Return the truth's ranks (D,), in 0..1: the weight of the particles below it, plus half of that of equal ones.

    It is the probability integral transform, which is uniform for a calibrated posterior (Hamill 2001). weights_below:
    (2, D), see `weight_below`.
    """
    below, equal = weights_below
    return (below + 0.5 * equal).clip(max=1.0)  # the sum's rounding


def weight_below(values: FloatArray, weights: FloatArray, truth: FloatArray) -> FloatArray:
    """Return the weight of the particles below the truth, and of those equal to it, (2, D)."""
    columns, below = np.ascontiguousarray(values.T), np.zeros((2, len(truth)))
    parallel_for(
        lambda first, last: _add_weights_below(first, last, columns, weights, truth, below), *_columns_of(values)
    )
    return below


def expected_calibration_error(all_ranks: FloatArray) -> float:
    """Return the mean distance of the coverage of the central 10, 20, … 90 % intervals from their levels.

    This is the error of Naeini et al. (AAAI 2015), for intervals: 0 if calibrated, at most 0.5.
    """
    levels = np.linspace(0.1, 0.9, 9)
    return float(np.abs((np.abs(all_ranks - 0.5)[:, None] <= 0.5 * levels).mean(axis=0) - levels).mean())


def crps(values: FloatArray, weights: FloatArray, truth: FloatArray) -> FloatArray:
    """Return the continuous ranked probability score (D,), E|x − truth| − ½ E|x − x′|, in the quantity's unit.

    Gneiting & Raftery 2007, eq. 21. It is the absolute error where all particles are equal.
    """
    columns, score = np.ascontiguousarray(values.T), np.empty(len(truth))

    def some(first: int, last: int) -> None:
        _add_scores(first, last, columns, _stable_orders(columns[first:last]), weights, truth, score)

    parallel_for(some, *_columns_of(values))
    return score


def moments(values: FloatArray, weights: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return mean and variance, (D,) each, of particles (N, D) with normalised weights (N,)."""
    columns, result = np.ascontiguousarray(values.T), np.empty((2, values.shape[1]))
    parallel_for(lambda first, last: _add_moments(first, last, columns, weights, result), *_columns_of(values))
    return result[0], result[1]


def gaussian_nll(mean: FloatArray, variance: FloatArray, truth: FloatArray) -> FloatArray:
    """Return the negative log likelihood of the truth (D,), nats, under normal distributions with the `moments` given.

    Particles have no density, so a normal distribution replaces it (Dawid & Sebastiani 1999). For variance 0 it is −∞
    where the truth equals the mean, and ∞ elsewhere.
    """
    with np.errstate(divide="ignore", invalid="ignore"):
        score = 0.5 * (np.log(2.0 * np.pi * variance) + (truth - mean) ** 2 / variance)
    return np.where(variance > 0.0, score, np.where(truth == mean, -np.inf, np.inf))


def _columns_of(values: FloatArray) -> tuple[int, int]:
    """Return the number of columns of values (N, D), and how many are worth a thread."""
    return values.shape[1], 1 + _MIN_VALUES // (1 + len(values))


def _stable_orders(columns: FloatArray) -> IntArray:
    """Return the stable sorting orders (K, N) of columns (K, N), since the order of equal values decides the rounding.

    NumPy's stable sort takes several times as long as its default one, which suffices for distinct values.
    """
    orders = np.argsort(columns, axis=1)
    ordered = np.take_along_axis(columns, orders, axis=1)
    tied = (ordered[:, 1:] == ordered[:, :-1]).any(axis=1)
    orders[tied] = np.argsort(columns[tied], axis=1, kind="stable")
    return orders


@kernel(error_model="numpy")
def _add_moments(first: int, last: int, columns: Any, weights: Any, result: Any) -> None:
    for d in range(first, last):
        mean, variance, column = 0.0, 0.0, columns[d]
        for i in range(weights.shape[0]):
            mean += weights[i] * column[i]
        for i in range(weights.shape[0]):
            deviation = column[i] - mean
            variance += weights[i] * (deviation * deviation)
        result[0, d], result[1, d] = mean, variance


@kernel(error_model="numpy")
def _add_scores(first: int, last: int, columns: Any, orders: Any, weights: Any, truth: Any, score: Any) -> None:
    """orders: (last − first, N)."""
    for d in range(first, last):
        score[d] = _score(columns[d], orders[d - first], weights, truth[d])


@kernel(error_model="numpy")
def _add_weights_below(first: int, last: int, columns: Any, weights: Any, truth: Any, result: Any) -> None:
    for d in range(first, last):
        below, equal, true = 0.0, 0.0, truth[d]
        for i in range(weights.shape[0]):
            x = columns[d, i]
            below += weights[i] * (1.0 if x < true else 0.0)
            equal += weights[i] * (1.0 if x == true else 0.0)
        result[0, d], result[1, d] = below, equal


@inlined_exactly
def _score(column: Any, order: Any, weights: Any, truth: float) -> float:
    """Return the `crps` of a column (N,) with the sorting order (N,)."""
    error, spread, reached, before = 0.0, 0.0, 0.0, column[order[0]]
    for k in order:
        x = column[k]
        # half of E|x − x'| = Σ over gaps between neighbours of gap · F (1 − F)
        spread += (x - before) * reached * (1.0 - reached)
        error += weights[k] * abs(x - truth)
        reached += weights[k]
        before = x
    return error - spread
