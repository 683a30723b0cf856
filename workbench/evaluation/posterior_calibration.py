"""Whether a posterior says how sure it may be: coverage, ranks, and proper scores of weighted particles.

values: (N, D) of N particles; weights: (N,), normalised; truth: (D,). Every function gives one number for each of the D
quantities, in their units. For particles from the true posterior coverage is the band's level, ranks are even, and the
scores, which are proper, are smallest in the mean (Gneiting & Raftery, JASA 102, 2007).
"""

from typing import Any

import numpy as np

from workbench.body.simd_kinematics import inlined_exactly
from workbench.utils.arrays import BoolArray, FloatArray, IntArray
from workbench.utils.kernel_cache import kernel
from workbench.utils.parallel import over_threads

_ROUNDING = 1e-12
"""Of a sum of weights."""
_DIGITS = 65535.0  # the largest number of 16 bits
_TINY = np.finfo(np.float64).tiny


def covered(shares: FloatArray, levels: tuple[float, ...]) -> BoolArray:
    """Tell (L, D) whether the truth lies in the central bands of these levels, 0.9 being from the 5 % to the 95 %
    quantile, see `intervals.weighted_quantiles`; told by the weight on either side, `weight_below` (2, D), which needs
    no sorting."""
    below, equal = shares
    tails = 0.5 - 0.5 * np.array(levels)[:, None]
    return (below + equal >= tails - _ROUNDING) & (below < 1.0 - tails - _ROUNDING)


def ranks(shares: FloatArray) -> FloatArray:
    """Return (D,) in 0..1: the weight of the particles below the truth, those equal to it counted half, of both (2, D)
    as `weight_below` tells them; the probability integral transform, which is evenly distributed for a calibrated
    posterior (Hamill 2001)."""
    below, equal = shares
    return (below + 0.5 * equal).clip(max=1.0)  # the sum's rounding


def weight_below(values: FloatArray, weights: FloatArray, truth: FloatArray) -> FloatArray:
    """Return (2, D): the weight of the particles below the truth, and of those equal to it."""
    columns, shares = np.ascontiguousarray(values.T), np.zeros((2, len(truth)))
    over_threads(lambda first, last: _add_shares(first, last, columns, weights, truth, shares), len(truth), 1)
    return shares


def rank_histogram(every: FloatArray, n_bins: int = 10) -> IntArray:
    """Count how many of all ranks lie in each of n_bins even bins (n_bins,): flat when calibrated, U-shaped when too
    sure, a hump when too unsure, a slope when biased."""
    return np.asarray(np.histogram(every, bins=n_bins, range=(0.0, 1.0))[0])


def expected_calibration_error(every: FloatArray) -> float:
    """Return the mean over the central bands of 10, 20, … 90 % of how far the share of all ranks within them is from
    their level (Naeini et al., AAAI 2015, for bands): 0 when calibrated, at most 0.5."""
    levels = np.linspace(0.1, 0.9, 9)
    return float(np.abs((np.abs(every - 0.5)[:, None] <= 0.5 * levels).mean(axis=0) - levels).mean())


def crps(values: FloatArray, weights: FloatArray, truth: FloatArray) -> FloatArray:
    """Return the continuous ranked probability score (D,): E|x − truth| − ½ E|x − x′| (Gneiting & Raftery 2007, eq.
    21), in the quantity's unit; the absolute error where all particles are equal."""
    columns, score = np.ascontiguousarray(values.T), np.empty(len(truth))

    def some(first: int, last: int) -> None:
        orders, digits = np.empty((2, len(values)), np.int32), np.empty(len(values), np.uint16)
        _add_scores(first, last, columns, weights, truth, orders, digits, np.empty(257, np.int64), score)

    over_threads(some, len(truth), 1)
    return score


def moments(values: FloatArray, weights: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return mean and variance, both (D,), of particles (N, D) with weights (N,) that sum to one."""
    columns, found = np.ascontiguousarray(values.T), np.empty((2, values.shape[1]))
    over_threads(lambda first, last: _add_moments(first, last, columns, weights, found), len(columns), 1)
    return found[0], found[1]


def gaussian_nll(mean: FloatArray, variance: FloatArray, truth: FloatArray) -> FloatArray:
    """Return −log p(truth), all (D,), nats, of the normal distribution with the particles' `moments` (Dawid &
    Sebastiani 1999): particles have no density of their own. Infinite where all are equal, but for a truth that equals
    them."""
    with np.errstate(divide="ignore", invalid="ignore"):
        score = 0.5 * (np.log(2.0 * np.pi * variance) + (truth - mean) ** 2 / variance)
    return np.where(variance > 0.0, score, np.where(truth == mean, -np.inf, np.inf))


@kernel(error_model="numpy")
def _add_moments(first: int, last: int, columns: Any, weights: Any, found: Any) -> None:
    for d in range(first, last):
        mean, variance, column = 0.0, 0.0, columns[d]
        for i in range(weights.shape[0]):
            mean += weights[i] * column[i]
        for i in range(weights.shape[0]):
            variance += weights[i] * (column[i] - mean) ** 2
        found[0, d], found[1, d] = mean, variance


@kernel(error_model="numpy")
def _add_scores(
    first: int, last: int, columns: Any, weights: Any, truth: Any, orders: Any, digits: Any, starts: Any, score: Any
) -> None:
    """orders (2, N), digits (N,) and starts (257,) are overwritten."""
    for d in range(first, last):
        _order(columns[d], digits, starts, orders[1], orders[0])
        score[d] = _score(columns[d], orders[0], weights, truth[d])


@inlined_exactly
def _order(column: Any, digits: Any, starts: Any, other: Any, order: Any) -> None:
    """Write what sorts a column (N,), ties as they are: by the lower and then by the upper half of 16 bits, and by
    insertion, which takes as many moves as there are neighbours left in the wrong order."""
    low = high = column[0]
    for x in column:
        low, high = min(low, x), max(high, x)
    reach = max(high - low, _TINY)
    for i in range(column.shape[0]):
        digits[i] = np.uint16(int((column[i] - low) / reach * _DIGITS))  # the score of what is not finite is NaN anyway
        other[i] = i
    for shift in range(0, 16, 8):
        for k in range(257):
            starts[k] = 0
        for digit in digits:
            starts[((digit >> shift) & 255) + 1] += 1
        for k in range(256):
            starts[k + 1] += starts[k]
        for i in other:
            half = (digits[i] >> shift) & 255
            order[starts[half]] = i
            starts[half] += 1
        for i in range(order.shape[0] * (shift == 0)):
            other[i] = order[i]
    for i in range(1, order.shape[0]):
        k, place = order[i], i
        while place > 0 and column[order[place - 1]] > column[k]:
            order[place] = order[place - 1]
            place -= 1
        order[place] = k


@kernel(error_model="numpy")
def _add_shares(first: int, last: int, columns: Any, weights: Any, truth: Any, shares: Any) -> None:
    for d in range(first, last):
        below, equal, true = 0.0, 0.0, truth[d]
        for i in range(weights.shape[0]):
            x = columns[d, i]
            below += weights[i] * (1.0 if x < true else 0.0)
            equal += weights[i] * (1.0 if x == true else 0.0)
        shares[0, d], shares[1, d] = below, equal


@inlined_exactly
def _score(column: Any, order: Any, weights: Any, truth: float) -> float:
    """Compute `crps` of a column (N,) of which the order (N,) is known."""
    apart, spread, reached, before = 0.0, 0.0, 0.0, column[order[0]]
    for k in order:
        x = column[k]
        # half of E|x − x'| = Σ over gaps between neighbours of gap · F (1 − F)
        spread += (x - before) * reached * (1.0 - reached)
        apart += weights[k] * abs(x - truth)
        reached += weights[k]
        before = x
    return apart - spread
