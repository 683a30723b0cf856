"""The period of cyclic motion with gaps, by its signal-to-noise ratio (paper B, section 2.1, eq. 1)."""

from collections.abc import Sequence
from itertools import pairwise

import numpy as np

from workbench.utils.arrays import FloatArray
from workbench.utils.errors import InputError

LEAST_NOISE = 1e-12
"""Noise never counts less than this fraction of the variance, so that an exact repetition has a finite ratio."""

HEAD_PERIODS = 3.0
REFINING_STEPS = 6


def snr(series: FloatArray, periods: Sequence[float] | FloatArray) -> FloatArray:
    """Signal-to-noise ratio (P,) of series (F, m), NaN where missing, at candidate periods (P,) in samples.

    The ratios of `snr_per_series` accumulated over the series: the square of their mean square root, about 1 for white
    noise. A deviation from the paper's sum: with gaps, a single angle that by chance repeats in the few samples seen
    twice can outweigh all others; the square root bounds its say. NaN where no degree of freedom is left for the noise.
    """
    roots = np.sqrt(snr_per_series(series, periods))
    usable = np.isfinite(roots)
    count = usable.sum(axis=1)
    mean = np.where(usable, roots, 0.0).sum(axis=1) / np.maximum(count, 1)
    return np.where(count > 0, mean**2, np.nan)


def snr_per_series(series: FloatArray, periods: Sequence[float] | FloatArray) -> FloatArray:
    """Signal-to-noise ratio (P, m) of each series of (F, m), NaN where missing, at periods (P,) in samples.

    The series is folded to its mean cycle z̄, and over the valid samples (EQUATIONS B, "Period"; the paper leaves the
    definition to its technical report)

        SNR(p) = [Σ (z̄ − mean)² / (p − 1)] / [Σ (z − z̄)² / (n_valid − p)],

    an F ratio: 1 on average for white noise at every p. With gaps, p counts the phases that were seen at all. NaN
    where fewer than two phases were seen or none was seen twice. A period need not be whole: cycle k then begins at
    the sample nearest to k p, so that many cycles do not drift apart.
    """
    candidates = np.asarray(periods, dtype=np.float64)
    if series.ndim != 2 or not len(series) or candidates.ndim != 1 or not (candidates >= 2.0).all():
        found = f"{series.shape} and {candidates}"
        raise InputError(f"period: expected series (F, m) and periods of 2 samples or more, found {found}")
    valid = np.isfinite(series)
    n_valid = valid.sum(axis=0)
    mean = np.where(valid, series, 0.0).sum(axis=0) / np.maximum(n_valid, 1)
    centred = np.where(valid, series - mean, 0.0)
    variation = (centred**2).sum(axis=0)
    both = np.concatenate([valid, centred], axis=1)
    ratios = np.full((len(candidates), series.shape[1]), np.nan)
    for row, period in enumerate(candidates):
        count, total = np.hsplit(_folded_sum(both, period), 2)
        explained = (total**2 / np.maximum(count, 1.0)).sum(axis=0)
        phases = (count > 0.0).sum(axis=0)
        usable = (phases > 1) & (n_valid > phases) & (variation > 0.0)
        signal = explained[usable] / (phases[usable] - 1)
        noise = np.maximum(variation - explained, LEAST_NOISE * variation)[usable] / (n_valid - phases)[usable]
        ratios[row, usable] = signal / noise
    return ratios


def find_period(series: FloatArray, shortest: float, longest: float) -> float:
    """The period in samples, between `shortest` and `longest`, with the largest accumulated SNR of series (F, m).

    Candidates lie so close that their cycles drift apart by a sample at most. They are tried on at most the first
    three longest periods; the best is then refined on twice as many samples at a time until all are used, and a
    parabola at the peak places it between the candidates. Only periods that fit twice into the series are candidates:
    with gaps, chance agreement of the few phases seen twice makes false peaks beyond. Twice the true period explains as
    much as the period itself, but spends more degrees of freedom; half of it, a walk's step, fits neither side.
    Raises InputError when there are fewer than three candidates, or when the ratio is largest at the end of the
    range, so that the series has no period inside it.
    """
    n = min(len(series), int(np.ceil(HEAD_PERIODS * longest)))
    most = min(longest, len(series) / 2.0)
    if shortest < 2.0 or most <= shortest:
        wanted = f"two periods of {shortest:g} samples (and those 2 at least)"
        raise InputError(f"period: expected at least {wanted}, found {len(series)}")
    n_steps = max(3, int(np.ceil(n * np.log(most / shortest))))
    candidates = shortest * (most / shortest) ** (np.arange(n_steps + 1) / n_steps)  # spaced by p / n
    ratios = snr(series[:n], candidates)
    if not np.isfinite(ratios).any():
        raise InputError("period: expected series with repeated samples, found too few valid ones")
    if (peak := int(np.nanargmax(ratios))) in (0, n_steps):
        raise InputError(
            f"period: expected a period between {shortest:g} and {most:g} samples (at most half of the {len(series)} "
            f"there are), found the signal-to-noise ratio largest at {candidates[peak]:.1f}"
        )
    period = _refined(candidates, ratios)
    while n < len(series):
        n = min(2 * n, len(series))
        candidates = period * (1.0 + np.arange(-REFINING_STEPS, REFINING_STEPS + 1) / n)
        period = _refined(candidates, snr(series[:n], candidates))
    return period


def _refined(candidates: FloatArray, ratios: FloatArray) -> float:
    """Find where the parabola through the ratios around the largest peaks; the largest itself where it has no peak.

    Least squares over three neighbours on either side, since whole samples make the ratio a staircase.
    """
    peak = int(np.nanargmax(ratios))
    near = np.arange(max(0, peak - 3), min(len(ratios), peak + 4))
    near = near[np.isfinite(ratios[near])]
    if len(near) < 3:
        return float(candidates[peak])
    spacing = candidates[1] - candidates[0]
    steps = (candidates[near] - candidates[peak]) / spacing
    curvature, slope, _ = np.polyfit(steps, ratios[near], 2)
    place = -0.5 * slope / curvature if curvature < 0.0 else 0.0
    return float(candidates[peak] + spacing * np.clip(place, steps[0], steps[-1]))


def _folded_sum(samples: FloatArray, period: float) -> FloatArray:
    """Sums (⌈p⌉, m) over the cycles of samples (F, m); cycle k begins at the sample nearest to k p."""
    n_cycles = int(np.ceil(len(samples) / period)) + 1
    starts = np.rint(np.arange(n_cycles + 1) * period).astype(np.int64)
    folded = np.zeros((int(np.ceil(period)), samples.shape[1]))
    for start, end in pairwise(starts):
        cycle = samples[start:end]
        folded[: len(cycle)] += cycle
    return folded
