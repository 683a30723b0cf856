"""Functional principal components of cycles with gaps (paper B, section 2.2).

Sequences are segmented into slices, cycles at common phases (step 1). The components are those of an iterated SVD in
the Fourier domain (steps 2–9).
"""

import logging
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial

import numpy as np
import scipy
from tqdm import tqdm

from workbench.motion.models.cycle_alignment import CycleAlignment
from workbench.utils.arrays import BoolArray, FloatArray, IntArray
from workbench.utils.errors import InputError

N_FOURIER = 20
"""Fourier coefficients of each slice (paper B, step 4): the constant, ten cosines and nine sines."""

SHRINKAGE = 0.025
TOLERANCE = 1e-6
MAX_ITERATIONS = 1000
log = logging.getLogger(__name__)


@dataclass(frozen=True, eq=False)
class Slices:
    """N cycles of sequences of m angles, sampled at T phases 0, 1/T, ….

    values : (N, T, m), with an initial estimate where nothing was observed. observed : (N, T, m). sequence : (N,), the
    index of each slice's sequence, ascending. cycle : (N,), the whole part of the phase, consecutive in a sequence.
    """

    values: FloatArray
    observed: BoolArray
    sequence: IntArray
    cycle: IntArray


def cut(sequences: Sequence[FloatArray], alignment: CycleAlignment, n_phases: int = 64) -> Slices:
    """Segment sequences (F_i, m), NaN where missing, into aligned cycles; phases beyond both ends are missing.

    The functional estimate is an interpolating cubic spline. A point of a cycle is observed if the samples on both
    sides are valid. The initial estimate of a missing point is the mean of the slices observed at that phase. Raises
    InputError if no slice is observed at some phase.
    """
    values, observed, sequence, cycle = [], [], [], []
    for i, series in enumerate(sequences):
        phases = alignment.phases(i, len(series))
        cycles = np.arange(int(np.floor(phases[0])), int(np.floor(phases[-1])) + 1)
        slice_phases = cycles[:, None] + np.arange(n_phases) / n_phases
        curve, valid = _resampled(series, (slice_phases - alignment.offsets[i]) * alignment.periods[i])
        values.append(curve)
        observed.append(valid)
        sequence.append(np.full(len(cycles), i))
        cycle.append(cycles)
    stacked, mask = np.concatenate(values), np.concatenate(observed)
    count = mask.sum(axis=0)
    if not count.all():
        phase, angle = np.argwhere(count == 0)[0]
        raise InputError(f"cycles: angle {angle} is never observed at phase {phase / n_phases:.2f} of the cycle")
    mean = np.where(mask, stacked, 0.0).sum(axis=0) / count
    return Slices(np.where(mask, stacked, mean), mask, np.concatenate(sequence), np.concatenate(cycle))


def fill_linear(series: FloatArray) -> FloatArray:
    """Return series (F, m) with gaps filled by linear interpolation in time, constant beyond the first and last sample.

    An angle without any valid sample becomes zero.
    """
    frames, valid = np.arange(len(series)), np.isfinite(series)
    filled = np.zeros(series.shape)
    for angle, rows in enumerate(valid.T):
        if rows.any():
            filled[:, angle] = np.interp(frames, frames[rows], series[rows, angle])
    return filled


def _resampled(series: FloatArray, frames: FloatArray) -> tuple[FloatArray, BoolArray]:
    """Return values (K, T, m) of a series (F, m) at frames (K, T), and where the samples on both sides are valid."""
    valid, last = np.isfinite(series), len(series) - 1
    inside = (frames >= 0.0) & (frames <= last)
    frames = np.clip(frames, 0.0, last)
    before, after = np.floor(frames).astype(np.int64), np.ceil(frames).astype(np.int64)
    observed: BoolArray = valid[before] & valid[after] & inside[:, :, None]
    return scipy.interpolate.CubicSpline(np.arange(len(series)), fill_linear(series))(frames), observed


@dataclass(frozen=True, eq=False)
class _FunctionalPca:
    """θ(ψ) = μ(ψ) + Σ_k c_k v_k(ψ) (paper B, eq. 2), sampled at T phases; every curve is a sum of 20 sinusoids.

    mean : (T, m). components : (d, T, m), orthonormal. scales : (d,), standard deviations of the coefficients c_k over
    the slices. explained : fraction of the completed slices' variance that the d components explain. curves :
    (N, 20, m), Fourier coefficients of the reconstructed slices. completed : (N, T, m), the slices with imputed missing
    values. errors : ‖X − X₄‖ in every iteration.
    """

    mean: FloatArray
    components: FloatArray
    scales: FloatArray
    explained: float
    curves: FloatArray
    completed: FloatArray
    errors: FloatArray


def fourier_basis(phases: FloatArray, n_phases: int) -> FloatArray:
    """Return the first 20 real Fourier functions (F, 20) at phases (F,) in cycles: 1, cos ψ, sin ψ, cos 2ψ, ….

    They are orthonormal over n_phases equidistant phases, which makes the iteration monotone. Their sums and all
    derivatives are periodic.
    """
    column = np.arange(N_FOURIER)
    turns = 2.0 * np.pi * phases[:, None] * ((column + 1) // 2)
    waves: FloatArray = np.where(column % 2 == 1, np.cos(turns), np.sin(turns)) * np.sqrt(2.0 / n_phases)
    waves[:, 0] = np.sqrt(1.0 / n_phases)
    return waves


def fpca_paper(slices: Slices, n_components: int = 5, tolerance: float = TOLERANCE) -> _FunctionalPca:
    """Return the functional PCA by the paper's steps 2–9: truncate to q singular values, impute, iterate.

    The iteration stops when ‖X − X₄‖ decreases by less than the fraction `tolerance`, or with a warning after 1000
    iterations. Deviations: the tolerance is relative, independent of units; the Fourier functions are real and
    orthonormal; the returned mean is projected on them too, because the row mean of real cycles is not periodic. Raises
    InputError if there are not more slices than components.
    """
    return _fpca(slices, n_components, partial(_keep_largest, n_components), tolerance)


def fpca_shrunk(slices: Slices, n_components: int = 5) -> _FunctionalPca:
    """Return the functional PCA with soft-thresholded singular values around every sequence's centre.

    All singular values are reduced by SHRINKAGE times the largest one of the initial estimate (spectral
    regularisation), so that no rank is chosen and incomplete cycles are not overfitted. Each sequence's mean angles,
    which are posture rather than motion, are not shrunk. The components are those of the completed slices. Raises
    InputError as `fpca_paper`.

    References
    ----------
    Mazumder, Hastie & Tibshirani, Spectral Regularization Algorithms, 2010.
    """
    first = _spectra(slices.values - slices.values.mean(axis=0))
    largest = np.linalg.norm((first - _centres(first, slices)).reshape(len(first), -1), 2)
    return _fpca(slices, n_components, partial(_soften, float(SHRINKAGE * largest), slices), TOLERANCE)


def _fpca(
    slices: Slices, n_components: int, reconstruct: Callable[[FloatArray], tuple[FloatArray, float]], tolerance: float
) -> _FunctionalPca:
    """Iterate steps 2–9; `reconstruct` is steps 5–6: from spectra (N, 20, m) of X − 1μᵀ to a low rank and its
    penalty."""
    n, n_phases, n_angles = slices.values.shape
    if not 1 <= n_components <= (maximum := min(n - 1, N_FOURIER * n_angles)):
        raise InputError(f"functional PCA: {n} slices allow 1 to {maximum} components, found {n_components}")
    basis = fourier_basis(np.arange(n_phases) / n_phases, n_phases)
    x, complete = slices.values, bool(slices.observed.all())
    errors: list[float] = []
    for _ in tqdm(range(MAX_ITERATIONS), desc="functional PCA", unit="iteration", leave=False, disable=None):
        mean = x.mean(axis=0)
        curves, penalty = reconstruct(_spectra(x - mean))
        fitted = basis @ curves + mean
        errors.append(float(np.sqrt(np.sum((x - fitted) ** 2) + penalty)))
        if complete:
            break
        x = np.where(slices.observed, x, fitted)
        if len(errors) > 1 and abs(errors[-2] - errors[-1]) <= tolerance * errors[-2]:
            break
    else:
        log.warning("functional PCA: not converged to %g after %d iterations", tolerance, MAX_ITERATIONS)
    mean_curve = _spectra(mean)
    spectra = _spectra(x - x.mean(axis=0))
    rows, singular = _principal(spectra.reshape(len(x), -1), n_components)
    return _FunctionalPca(
        mean=basis @ mean_curve, components=basis @ rows.reshape(n_components, N_FOURIER, -1),
        scales=singular / np.sqrt(len(x) - 1), explained=float(np.sum(singular**2) / np.sum(spectra**2)),
        curves=curves + mean_curve, completed=x, errors=np.array(errors),
    )  # fmt: skip


def _spectra(curves: FloatArray) -> FloatArray:
    """Return the Fourier coefficients (..., 20, m) of curves (..., T, m)."""
    n_phases = curves.shape[-2]
    return fourier_basis(np.arange(n_phases) / n_phases, n_phases).T @ curves


def _keep_largest(n_components: int, spectra: FloatArray) -> tuple[FloatArray, float]:
    smaller = min(len(spectra), spectra[0].size)
    return _low_rank(spectra, 0.0, by_index=(max(smaller - n_components, 0), smaller - 1))[0], 0.0


def _soften(threshold: float, slices: Slices, spectra: FloatArray) -> tuple[FloatArray, float]:
    centres = _centres(spectra, slices)
    softened, nuclear_norm = _low_rank(spectra - centres, threshold, by_value=(threshold**2, np.inf))
    return centres + softened, 2.0 * threshold * nuclear_norm


def _centres(spectra: FloatArray, slices: Slices) -> FloatArray:
    """Return (N, 20, m): the constant coefficient's mean over the slices of the same sequence; zero elsewhere."""
    _, group, size = np.unique(slices.sequence, return_inverse=True, return_counts=True)
    sums = np.zeros((len(size), spectra.shape[2]))
    np.add.at(sums, group, spectra[:, 0])
    centres = np.zeros_like(spectra)
    centres[:, 0] = (sums / size[:, None])[group]
    return centres


def _low_rank(
    spectra: FloatArray, lower: float, *, by_index: tuple[int, int] | None = None,
    by_value: tuple[float, float] | None = None,
) -> tuple[FloatArray, float]:  # fmt: skip
    """Return spectra (N, 20, m), as N rows, from selected singular values reduced by `lower`, and the sum of these.

    by_index, by_value : select the squared singular values by ascending rank or by range. The eigenvectors of the
    smaller of XᵀX and XXᵀ are many times faster than an SVD; singular values below 1e-8 of the largest, which they
    lose, are negligible.
    """
    x = spectra.reshape(len(spectra), -1)
    tall = x.shape[0] > x.shape[1]
    values, vectors = scipy.linalg.eigh(
        x.T @ x if tall else x @ x.T, subset_by_index=by_index, subset_by_value=by_value
    )
    singular = np.sqrt(np.maximum(values, 0.0))
    used = singular > lower
    shrunk, basis = singular[used] - lower, vectors[:, used]
    fraction = shrunk / singular[used]
    low_rank = (x @ basis * fraction) @ basis.T if tall else (basis * fraction) @ (basis.T @ x)
    return low_rank.reshape(spectra.shape), float(shrunk.sum())


def _principal(x: FloatArray, n_components: int) -> tuple[FloatArray, FloatArray]:
    """Return the first right singular vectors (rows) and singular values of x; each largest entry is positive."""
    n, size = x.shape
    if n > size:
        values, vectors = scipy.linalg.eigh(x.T @ x, subset_by_index=(size - n_components, size - 1))
        rows, singular = vectors.T[::-1], np.sqrt(np.maximum(values[::-1], 0.0))
    else:
        rows, singular = (part[:n_components] for part in np.linalg.svd(x, full_matrices=False)[:0:-1])
    largest = rows[np.arange(len(rows)), np.abs(rows).argmax(axis=1)]
    return rows * np.where(largest < 0.0, -1.0, 1.0)[:, None], singular
