"""Whether a posterior says how sure it may be: coverage, ranks, and proper scores of weighted particles.

values: (N, D) of N particles; weights: (N,), normalised; truth: (D,). Every function gives one number for each of the D
quantities, in their units. For particles from the true posterior coverage is the band's level, ranks are even, and the
scores, which are proper, are smallest in the mean (Gneiting & Raftery, JASA 102, 2007).
"""

import numpy as np

from workbench.arrays import BoolArray, FloatArray, IntArray
from workbench.evaluation.posterior import weighted_quantiles


def covered(values: FloatArray, weights: FloatArray, truth: FloatArray, levels: tuple[float, ...]) -> BoolArray:
    """(L, D): whether the truth lies in the central bands of these levels, 0.9 being from the 5 % to the 95 %
    quantile."""
    ends = [0.5 + sign * 0.5 * level for level in levels for sign in (-1.0, 1.0)]
    quantiles = weighted_quantiles(values, weights, tuple(ends)).reshape(len(levels), 2, -1)
    inside: BoolArray = (quantiles[:, 0] <= truth) & (truth <= quantiles[:, 1])
    return inside


def ranks(values: FloatArray, weights: FloatArray, truth: FloatArray) -> FloatArray:
    """(D,) in 0..1: the weight of the particles below the truth, those equal to it counted half; the probability
    integral transform, which is evenly distributed for a calibrated posterior (Hamill 2001)."""
    below = weights @ (values < truth) + 0.5 * (weights @ (values == truth))
    return np.asarray(below, dtype=np.float64)


def rank_histogram(every: FloatArray, n_bins: int = 10) -> IntArray:
    """How many of all ranks lie in each of n_bins even bins (n_bins,): flat when calibrated, U-shaped when too sure,
    a hump when too unsure, a slope when biased."""
    return np.asarray(np.histogram(every, bins=n_bins, range=(0.0, 1.0))[0])


def crps(values: FloatArray, weights: FloatArray, truth: FloatArray) -> FloatArray:
    """The continuous ranked probability score (D,): E|x − truth| − ½ E|x − x′| (Gneiting & Raftery 2007, eq. 21), in
    the quantity's unit; the absolute error where all particles are equal."""
    columns = np.ascontiguousarray(values.T)
    order = np.argsort(columns, axis=1)
    x, reached = np.take_along_axis(columns, order, axis=1), np.cumsum(weights[order], axis=1)[:, :-1]
    # half of E|x − x'| = Σ over gaps between neighbours of gap · F (1 − F)
    spread = (np.diff(x, axis=1) * reached * (1.0 - reached)).sum(axis=1)
    score: FloatArray = (np.abs(columns - truth[:, None]) * weights).sum(axis=1) - spread
    return score


def log_score(values: FloatArray, weights: FloatArray, truth: FloatArray) -> FloatArray:
    """−log p(truth), (D,), nats, of the normal distribution with the particles' mean and variance (Dawid & Sebastiani
    1999): particles have no density of their own. Infinite where all are equal, but for a truth that equals them."""
    mean = weights @ values
    variance = weights @ (values - mean) ** 2
    with np.errstate(divide="ignore", invalid="ignore"):
        score = 0.5 * (np.log(2.0 * np.pi * variance) + (truth - mean) ** 2 / variance)
    return np.where(variance > 0.0, score, np.where(truth == mean, -np.inf, np.inf))
