"""Periods and phase alignment of cyclic sequences with gaps (paper B, section 2.1)."""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
import scipy

from workbench.motion.pose_sequence import MAX_CYCLE_S, MIN_CYCLE_S, Motion
from workbench.utils.arrays import FloatArray, IntArray
from workbench.utils.errors import InputError
from workbench.utils.nan_statistics import nan_mean

MIN_NOISE = 1e-12
"""Lower bound of the noise as a fraction of the variance, so that an exact repetition has a finite ratio."""

HEAD_PERIODS = 3.0
REFINEMENT_STEPS = 6

N_PHASES = 256
N_KNOTS = 16
MAX_ITERATIONS = 100
TOLERANCE = 1e-6


def snr(series: FloatArray, periods: Sequence[float] | FloatArray, summed: bool = False) -> FloatArray:
    """Return the signal-to-noise ratio (P,) of series (F, m), NaN where missing, at periods (P,) in samples.

    The ratios of `snr_per_series` are combined over the series as the square of their mean square root, about 1 for
    white noise; if `summed`, they are added as in the paper. With gaps, a single angle that repeats by chance in the
    few samples observed twice can outweigh all others in the sum; the square root limits its influence. NaN where no
    degree of freedom remains for the noise.
    """
    ratios = snr_per_series(series, periods)
    if summed:
        return np.where(np.isfinite(ratios).any(axis=1), np.nansum(ratios, axis=1), np.nan)
    return nan_mean(np.sqrt(ratios), axis=1) ** 2


def snr_per_series(series: FloatArray, periods: Sequence[float] | FloatArray) -> FloatArray:
    """Return the signal-to-noise ratio (P, m) of each series of (F, m), NaN where missing, at periods (P,) in samples.

    The series is folded to its mean cycle z̄, and over the valid samples (EQUATIONS B, "Period"; the paper leaves the
    definition to its technical report)

        SNR(p) = [Σ (z̄ − mean)² / (p − 1)] / [Σ (z − z̄)² / (n_valid − p)],

    an F ratio: 1 on average for white noise at every p. With gaps, p is the number of observed phases. NaN where
    fewer than two phases are observed or none is observed twice. For a fractional period, cycle k begins at the sample
    nearest to k p, so that many cycles stay aligned. Raises InputError for a wrong shape, or a period below 2 samples.
    """
    candidates = np.asarray(periods, dtype=np.float64)
    if series.ndim != 2 or not len(series) or candidates.ndim != 1 or not (candidates >= 2.0).all():
        shapes = f"{series.shape} and {candidates}"
        raise InputError(f"period: expected series (F, m) and periods of 2 samples or more, found {shapes}")
    valid = np.isfinite(series)
    n_valid = valid.sum(axis=0)
    centred = np.where(valid, series - nan_mean(series, axis=0), 0.0)
    variation = (centred**2).sum(axis=0)
    samples = np.concatenate([valid, centred], axis=1)
    ratios = np.full((len(candidates), series.shape[1]), np.nan)
    for row, period in enumerate(candidates):
        count, total = np.hsplit(_folded_sum(samples, period), 2)
        explained = (total**2 / np.maximum(count, 1.0)).sum(axis=0)
        phases = (count > 0.0).sum(axis=0)
        usable = (phases > 1) & (n_valid > phases) & (variation > 0.0)
        signal = explained[usable] / (phases[usable] - 1)
        noise = np.maximum(variation - explained, MIN_NOISE * variation)[usable] / (n_valid - phases)[usable]
        ratios[row, usable] = signal / noise
    return ratios


def find_period(series: FloatArray, shortest: float, longest: float, summed: bool = False) -> float:
    """Return the period in samples, between `shortest` and `longest`, with the largest SNR of series (F, m);
    `summed` as for `snr`.

    The spacing of the candidates limits the drift between their cycles to one sample. They are evaluated on at most the
    first three longest periods. The best is refined on twice as many samples at a time until all are used, with a
    parabola at the peak. Only periods that fit twice into the series are candidates: beyond, with gaps, chance
    agreement of the few phases observed twice causes false peaks. Twice the true period explains as much as the period
    itself, but has fewer degrees of freedom; half of it, the step of a walk, fits neither side. Raises InputError
    if there are fewer than three candidates, or the ratio is largest at the end of the range, so that the series has no
    period inside it.
    """
    n = min(len(series), int(np.ceil(HEAD_PERIODS * longest)))
    upper = min(longest, len(series) / 2.0)
    if shortest < 2.0 or upper <= shortest:
        wanted = f"two periods of {shortest:g} samples (and those 2 at least)"
        raise InputError(f"period: expected at least {wanted}, found {len(series)}")
    n_steps = max(3, int(np.ceil(n * np.log(upper / shortest))))
    candidates = shortest * (upper / shortest) ** (np.arange(n_steps + 1) / n_steps)  # spaced by p / n
    ratios = snr(series[:n], candidates, summed)
    if not np.isfinite(ratios).any():
        raise InputError("period: expected series with repeated samples, found too few valid ones")
    if (peak := int(np.nanargmax(ratios))) in (0, n_steps):
        raise InputError(
            f"period: expected a period between {shortest:g} and {upper:g} samples (at most half of the {len(series)} "
            f"there are), found the signal-to-noise ratio largest at {candidates[peak]:.1f}"
        )
    period = _refined(candidates, ratios)
    while n < len(series):
        n = min(2 * n, len(series))
        candidates = period * (1.0 + np.arange(-REFINEMENT_STEPS, REFINEMENT_STEPS + 1) / n)
        period = _refined(candidates, snr(series[:n], candidates, summed))
    return period


def motion_period(motion: Motion, angles: FloatArray, summed: bool = False) -> float:
    """Return the period, in frames, of a motion's angles (F, m), between the shortest and the longest stride."""
    return find_period(angles, MIN_CYCLE_S * motion.rate_hz, MAX_CYCLE_S * motion.rate_hz, summed)


def _refined(candidates: FloatArray, ratios: FloatArray) -> float:
    """Return the peak of the parabola through the ratios around the maximum; the maximum itself if it has no peak.

    Least squares over three neighbours on either side, since integer sample positions make the ratio piecewise
    constant.
    """
    peak = int(np.nanargmax(ratios))
    window = np.arange(max(0, peak - 3), min(len(ratios), peak + 4))
    window = window[np.isfinite(ratios[window])]
    if len(window) < 3:
        return float(candidates[peak])
    spacing = candidates[1] - candidates[0]
    steps = (candidates[window] - candidates[peak]) / spacing
    curvature, slope, _ = np.polyfit(steps, ratios[window], 2)
    vertex = -0.5 * slope / curvature if curvature < 0.0 else 0.0
    return float(candidates[peak] + spacing * np.clip(vertex, steps[0], steps[-1]))


def _folded_sum(samples: FloatArray, period: float) -> FloatArray:
    """Return sums (⌈p⌉, m) over the cycles of samples (F, m); cycle k begins at the sample nearest to k p."""
    n_cycles = int(np.ceil(len(samples) / period)) + 1
    starts = np.rint(np.arange(n_cycles + 1) * period).astype(np.int64)
    folded = np.zeros((int(np.ceil(period)), samples.shape[1]))
    for start, end in pairwise(starts):
        cycle = samples[start:end]
        folded[: len(cycle)] += cycle
    return folded


@dataclass(frozen=True, eq=False)
class CycleAlignment:
    """Periods (n,) in samples and offsets (n,) in cycles, 0 to 1: frame t has phase t / period_i + offset_i.

    reference : (T, m), the reference signal r_a at phases 0, 1/T, …, in the units of the sequences. errors : squared
    deviation from the reference, initially and after every iteration, Σ over all valid samples, each angle divided by
    its standard deviation.
    """

    periods: FloatArray
    offsets: FloatArray
    reference: FloatArray
    errors: FloatArray

    def phases(self, i: int, n_frames: int) -> FloatArray:
        """Return phases (F,) of the first frames of sequence i, in cycles; the whole part counts the cycles."""
        return np.arange(n_frames) / self.periods[i] + self.offsets[i]


def align(sequences: Sequence[FloatArray], periods: Sequence[float] | FloatArray) -> CycleAlignment:
    """Return offsets that align sequences (F_i, m), NaN where missing, with periods (n,) in samples.

    From offsets of zero, (1) fit a periodic cubic regression spline with N_KNOTS knots to all folded, shifted data;
    (2) choose every offset with the smallest deviation from it; repeat until the error decreases by less than the
    fraction TOLERANCE. Both steps minimise the same sum, so that it never increases. A second initialisation uses the
    first sequence alone as reference, because sequences in opposite phase cancel in the paper's initial reference; the
    result with the smaller error is returned.

    Deviations: angles are divided by their standard deviation, so that all have equal weight. Phases are rounded to
    1/256 of a cycle (half a sample at 130 samples), so that the cost of an iteration is independent of the length.
    Raises InputError if the sequences have different shapes, or an angle has no valid sample in any of them.
    """
    if not sequences or len({s.shape[1:] for s in sequences}) != 1 or len(periods) != len(sequences):
        raise InputError("alignment: expected sequences (F, m) of the same m, and one period for each")
    periods = np.asarray(periods, dtype=np.float64)
    scale = _standard_deviations(sequences)
    folded = _fold(sequences, periods, scale)
    spline = periodic_basis(np.arange(N_PHASES) / N_PHASES, N_KNOTS)
    all_sequences = _fit(spline, folded.counts.sum(axis=0), folded.totals.sum(axis=0))
    first_sequence = _fit(spline, folded.counts[0], folded.totals[0])
    results = [_iterate(folded, spline, initial) for initial in (all_sequences, first_sequence)]
    shifts, reference, errors = min(results, key=lambda result: result[2][-1])
    return CycleAlignment(periods, shifts / N_PHASES, reference * scale, np.array(errors))


def periodic_basis(phases: FloatArray, n_knots: int) -> FloatArray:
    """Return cardinal periodic cubic splines (..., K) at phases (...) in cycles, with K equidistant knots."""
    knots = np.linspace(0.0, 1.0, n_knots + 1)
    unit = np.eye(n_knots)
    return scipy.interpolate.CubicSpline(knots, np.vstack([unit, unit[:1]]), bc_type="periodic")(phases % 1.0)


def fit_periodic(basis: FloatArray, weights: FloatArray, values: FloatArray, roughness: float = 0.0) -> FloatArray:
    """Return coefficients (K, m) of the weighted least-squares fit of basis (F, K) to values (F, m).

    weights : (F, m). roughness : weight of the squared second differences of neighbouring coefficients (P-splines,
    Eilers & Marx 1996). If the data do not determine a coefficient, the minimum-norm solution is used.
    """
    k = basis.shape[1]
    normal = np.einsum("fk,fa,fl->akl", basis, weights, basis, optimize=True)
    if roughness > 0.0:
        differences = np.roll(np.eye(k), 1, axis=0) - 2.0 * np.eye(k) + np.roll(np.eye(k), -1, axis=0)
        normal = normal + roughness * differences.T @ differences
    right = np.einsum("fk,fa->ak", basis, weights * values)
    return (np.linalg.pinv(normal, rcond=1e-10, hermitian=True) @ right[:, :, None])[:, :, 0].T


def _iterate(folded: "_Folded", spline: FloatArray, reference: FloatArray) -> tuple[IntArray, FloatArray, list[float]]:
    """Return shifts (n,) in phases, the reference (T, m), and the errors initially and after every iteration."""
    sequences = np.arange(len(folded.counts))
    shifts = np.zeros(len(sequences), dtype=np.int64)
    deviations = _deviations(folded, reference)
    errors = [folded.squares + float(deviations[:, 0].sum())]
    for _ in range(MAX_ITERATIONS):
        best = deviations.argmin(axis=1)
        gain = deviations[sequences, shifts] - deviations[sequences, best]
        # an offset changes only for a significant gain, not by ties or rounding
        moved = np.where(gain > 1e-12 * folded.squares, best, shifts)
        fitted = _fit(spline, _shifted(folded.counts, moved).sum(axis=0), _shifted(folded.totals, moved).sum(axis=0))
        deviations = _deviations(folded, fitted)
        error = folded.squares + float(deviations[sequences, moved].sum())
        if error >= errors[-1]:
            break
        shifts, reference = moved, fitted
        errors.append(error)
        if errors[-2] - error <= TOLERANCE * errors[-2]:
            break
    return shifts, reference, errors


@dataclass(frozen=True, eq=False)
class _Folded:
    """Counts and sums (n, T, m) of the valid, scaled samples by phase, and the sum of their squares."""

    counts: FloatArray
    totals: FloatArray
    squares: float


def _fold(sequences: Sequence[FloatArray], periods: FloatArray, scale: FloatArray) -> _Folded:
    counts = np.zeros((len(sequences), N_PHASES, len(scale)))
    totals = np.zeros_like(counts)
    squares = 0.0
    for i, (series, period) in enumerate(zip(sequences, periods, strict=True)):
        valid = np.isfinite(series)
        scaled = np.where(valid, series / scale, 0.0)
        phase = np.rint(np.arange(len(series)) / period * N_PHASES).astype(np.int64) % N_PHASES
        np.add.at(counts[i], phase, valid)
        np.add.at(totals[i], phase, scaled)
        squares += float((scaled**2).sum())
    return _Folded(counts, totals, squares)


def _standard_deviations(sequences: Sequence[FloatArray]) -> FloatArray:
    """Return the standard deviation (m,) of every angle about its mean in each sequence; 1 for a constant angle."""
    n_valid, variation = np.zeros(sequences[0].shape[1]), np.zeros(sequences[0].shape[1])
    for series in sequences:
        valid = np.isfinite(series)
        n_valid += valid.sum(axis=0)
        variation += (np.where(valid, series - nan_mean(series, axis=0), 0.0) ** 2).sum(axis=0)
    if not n_valid.all():
        raise InputError(f"alignment: angle {int(n_valid.argmin())} has no valid sample in any sequence")
    return np.where(variation > 0.0, np.sqrt(variation / n_valid), 1.0)


def _fit(spline: FloatArray, counts: FloatArray, totals: FloatArray) -> FloatArray:
    return spline @ fit_periodic(spline, counts, totals / np.maximum(counts, 1.0))


def _deviations(folded: _Folded, reference: FloatArray) -> FloatArray:
    """Return the squared deviation (n, T) of every sequence from the reference at every shift, without Σ z².

    Σ_b Σ_a counts(b) r²(b + s) − 2 totals(b) r(b + s): two circular correlations.
    """
    spectrum = np.conj(np.fft.rfft(folded.counts, axis=1)) * np.fft.rfft(reference**2, axis=0)
    spectrum -= 2.0 * np.conj(np.fft.rfft(folded.totals, axis=1)) * np.fft.rfft(reference, axis=0)
    return np.fft.irfft(spectrum.sum(axis=2), n=N_PHASES, axis=1)


def _shifted(folded: FloatArray, shifts: IntArray) -> FloatArray:
    """Return (n, T, m) with every sequence shifted."""
    indices = (np.arange(N_PHASES) - shifts[:, None]) % N_PHASES
    return np.take_along_axis(folded, indices[:, :, None], axis=1)
