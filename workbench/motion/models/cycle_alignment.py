"""Bringing cyclic sequences to one phase (paper B, section 2.1)."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import scipy

from workbench.utils.arrays import FloatArray, IntArray
from workbench.utils.errors import InputError

N_PHASES = 256
N_KNOTS = 16
MOST_PASSES = 100


@dataclass(frozen=True, eq=False)
class Alignment:
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


def align(sequences: Sequence[FloatArray], periods: Sequence[float] | FloatArray, tolerance: float = 1e-6) -> Alignment:
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
    return Alignment(periods, shifts / N_PHASES, reference * scale, np.array(errors))


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
