"""Period and common phase of cyclic sequences with gaps (paper B, section 2.1)."""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
import scipy

from workbench.motion.pose_sequence import LONGEST_S, SHORTEST_S, Motion
from workbench.utils.arrays import FloatArray, IntArray
from workbench.utils.errors import InputError

LEAST_NOISE = 1e-12
"""Noise never counts less than this fraction of the variance, so that an exact repetition has a finite ratio."""

HEAD_PERIODS = 3.0
REFINING_STEPS = 6

N_PHASES = 256
N_KNOTS = 16
MOST_PASSES = 100


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


def motion_period(motion: Motion, angles: FloatArray) -> float:
    """Return the period, in frames, of a motion's angles (F, m), between the shortest and the longest stride."""
    return find_period(angles, SHORTEST_S * motion.rate_hz, LONGEST_S * motion.rate_hz)


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


@dataclass(frozen=True, eq=False)
class CycleAlignment:
    """Periods (n,) in samples and offsets (n,) in cycles, 0 to 1: frame t has phase t / period_i + offset_i.

    reference: (T, m), the reference signal r_a at phases 0, 1/T, …, in the units of the sequences. errors: with the
    first reference and after every pass, the squared deviation from the reference, Σ over all valid samples, each
    angle divided by its standard deviation.
    """

    periods: FloatArray
    offsets: FloatArray
    reference: FloatArray
    errors: FloatArray

    def phases(self, i: int, n_frames: int) -> FloatArray:
        """Phases (F,) of the first frames of sequence i, in cycles, growing: the whole part counts the cycles."""
        return np.arange(n_frames) / self.periods[i] + self.offsets[i]


def align(
    sequences: Sequence[FloatArray], periods: Sequence[float] | FloatArray, tolerance: float = 1e-6
) -> CycleAlignment:
    """Offsets that bring sequences (F_i, m), NaN where missing, with periods (n,) in samples, to a common phase.

    From offsets of zero: (1) fit a periodic cubic regression spline with N_KNOTS knots to all folded, shifted data;
    (2) choose every offset anew to deviate least from it; until the error falls by less than the fraction
    `tolerance`. Both steps minimise the same sum, so that it never rises. A second start takes the first sequence
    alone as its reference, because sequences in opposite phase cancel in the paper's first reference; the start that
    ends with the smaller error is kept.

    Deviations: angles are divided by their standard deviation, so that none outweighs the others, and phases are
    rounded to 1/256 of a cycle (half a sample at 130 samples), so that a pass costs the same for any length.
    Raises InputError when the sequences do not go together or an angle has no valid sample in any of them.
    """
    if not sequences or len({s.shape[1:] for s in sequences}) != 1 or len(periods) != len(sequences):
        raise InputError("alignment: expected sequences (F, m) of the same m, and one period for each")
    periods = np.asarray(periods, dtype=np.float64)
    scale = _standard_deviations(sequences)
    folded = _fold(sequences, periods, scale)
    spline = periodic_basis(np.arange(N_PHASES) / N_PHASES, N_KNOTS)
    everyone = _fit(spline, folded.counts.sum(axis=0), folded.totals.sum(axis=0))
    first_alone = _fit(spline, folded.counts[0], folded.totals[0])
    ends = [_iterate(folded, spline, reference, tolerance) for reference in (everyone, first_alone)]
    shifts, reference, errors = min(ends, key=lambda end: end[2][-1])
    return CycleAlignment(periods, shifts / N_PHASES, reference * scale, np.array(errors))


def periodic_basis(phases: FloatArray, n_knots: int) -> FloatArray:
    """(..., K) cardinal periodic cubic splines at phases (...) in cycles, K equidistant knots."""
    knots = np.linspace(0.0, 1.0, n_knots + 1)
    unit = np.eye(n_knots)
    return scipy.interpolate.CubicSpline(knots, np.vstack([unit, unit[:1]]), bc_type="periodic")(phases % 1.0)


def fit_periodic(basis: FloatArray, weights: FloatArray, values: FloatArray, roughness: float = 0.0) -> FloatArray:
    """Coefficients (K, m) of the least-squares fit of basis (F, K) to values (F, m), weighted by weights (F, m).

    roughness: weight of the squared second differences of neighbouring coefficients (Eilers & Marx 1996: P-splines).
    Where the data leave a coefficient open the smallest solution is taken.
    """
    k = basis.shape[1]
    normal = np.einsum("fk,fa,fl->akl", basis, weights, basis, optimize=True)
    if roughness > 0.0:
        bend = np.roll(np.eye(k), 1, axis=0) - 2.0 * np.eye(k) + np.roll(np.eye(k), -1, axis=0)
        normal = normal + roughness * bend.T @ bend
    right = np.einsum("fk,fa->ak", basis, weights * values)
    return (np.linalg.pinv(normal, rcond=1e-10, hermitian=True) @ right[:, :, None])[:, :, 0].T


def _iterate(
    folded: "_Folded", spline: FloatArray, reference: FloatArray, tolerance: float
) -> tuple[IntArray, FloatArray, list[float]]:
    """Shifts (n,) in phases, the reference (T, m), and the error at the start and after every pass."""
    sequences = np.arange(len(folded.counts))
    shifts = np.zeros(len(sequences), dtype=np.int64)
    deviations = _deviations(folded, reference)
    errors = [folded.squares + float(deviations[:, 0].sum())]
    for _ in range(MOST_PASSES):
        best = deviations.argmin(axis=1)
        gain = deviations[sequences, shifts] - deviations[sequences, best]
        # an offset changes only for a real gain: ties and rounding must not make it wander
        moved = np.where(gain > 1e-12 * folded.squares, best, shifts)
        fitted = _fit(spline, _shifted(folded.counts, moved).sum(axis=0), _shifted(folded.totals, moved).sum(axis=0))
        deviations = _deviations(folded, fitted)
        error = folded.squares + float(deviations[sequences, moved].sum())
        if error >= errors[-1]:
            break
        shifts, reference = moved, fitted
        errors.append(error)
        if errors[-2] - error <= tolerance * errors[-2]:
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
    """Standard deviation (m,) of every angle around its mean in each sequence; 1 for one that never moves."""
    n_valid, variation = np.zeros(sequences[0].shape[1]), np.zeros(sequences[0].shape[1])
    for series in sequences:
        valid = np.isfinite(series)
        n = valid.sum(axis=0)
        mean = np.where(valid, series, 0.0).sum(axis=0) / np.maximum(n, 1)
        n_valid += n
        variation += (np.where(valid, series - mean, 0.0) ** 2).sum(axis=0)
    if not n_valid.all():
        raise InputError(f"alignment: angle {int(n_valid.argmin())} has no valid sample in any sequence")
    return np.where(variation > 0.0, np.sqrt(variation / n_valid), 1.0)


def _fit(spline: FloatArray, counts: FloatArray, totals: FloatArray) -> FloatArray:
    return spline @ fit_periodic(spline, counts, totals / np.maximum(counts, 1.0))


def _deviations(folded: _Folded, reference: FloatArray) -> FloatArray:
    """Squared deviation (n, T), less Σ z² over all sequences, of every sequence from the reference at every shift.

    Σ_b Σ_a counts(b) r²(b + s) − 2 totals(b) r(b + s): two circular correlations.
    """
    spectrum = np.conj(np.fft.rfft(folded.counts, axis=1)) * np.fft.rfft(reference**2, axis=0)
    spectrum -= 2.0 * np.conj(np.fft.rfft(folded.totals, axis=1)) * np.fft.rfft(reference, axis=0)
    return np.fft.irfft(spectrum.sum(axis=2), n=N_PHASES, axis=1)


def _shifted(folded: FloatArray, shifts: IntArray) -> FloatArray:
    """(n, T, m) with every sequence moved on by its shift."""
    places = (np.arange(N_PHASES) - shifts[:, None]) % N_PHASES
    return np.take_along_axis(folded, places[:, :, None], axis=1)
