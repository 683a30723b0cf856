"""Functional principal components of cycles with gaps (paper B, section 2.2).

Sequences are cut into slices, cycles at common phases (step 1); their components come from an iterated SVD in the
Fourier domain (steps 2–9).
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
"""Coefficients kept of each slice (paper B, step 4): the constant, ten cosines and nine sines."""

SHRINKAGE = 0.025
MOST_PASSES = 1000
log = logging.getLogger(__name__)


@dataclass(frozen=True, eq=False)
class Slices:
    """N cycles cut out of sequences of m angles and sampled at T phases 0, 1/T, ….

    values: (N, T, m), with a first guess where nothing was observed. observed: (N, T, m). sequence: (N,), the index
    of the sequence each comes from, ascending. cycle: (N,), the whole part of the phase, in a sequence without a break.
    """

    values: FloatArray
    observed: BoolArray
    sequence: IntArray
    cycle: IntArray


def cut(sequences: Sequence[FloatArray], alignment: CycleAlignment, n_phases: int = 64) -> Slices:
    """Cut sequences (F_i, m), NaN where missing, into aligned cycles; what lies beyond both ends counts as missing.

    The functional estimate is an interpolating cubic spline; a point of the cycle counts as observed where the
    samples on both sides of it are valid. The first guess of a missing point is the mean of the slices observed at
    that phase. Raises InputError where there is none.
    """
    values, observed, sequence, cycle = [], [], [], []
    for i, series in enumerate(sequences):
        phases = alignment.phases(i, len(series))
        cycles = np.arange(int(np.floor(phases[0])), int(np.floor(phases[-1])) + 1)
        places = cycles[:, None] + np.arange(n_phases) / n_phases
        curve, seen = _resampled(series, (places - alignment.offsets[i]) * alignment.periods[i])
        values.append(curve)
        observed.append(seen)
        sequence.append(np.full(len(cycles), i))
        cycle.append(cycles)
    stacked, known = np.concatenate(values), np.concatenate(observed)
    count = known.sum(axis=0)
    if not count.all():
        phase, angle = np.argwhere(count == 0)[0]
        raise InputError(f"cycles: angle {angle} was never seen at phase {phase / n_phases:.2f} of the cycle")
    mean = np.where(known, stacked, 0.0).sum(axis=0) / count
    return Slices(np.where(known, stacked, mean), known, np.concatenate(sequence), np.concatenate(cycle))


def fill_linear(series: FloatArray) -> FloatArray:
    """Series (F, m) with gaps filled by linear interpolation in time, constant beyond the first and last sample.

    An angle without any valid sample becomes zero.
    """
    frames, valid = np.arange(len(series)), np.isfinite(series)
    filled = np.zeros(series.shape)
    for angle, known in enumerate(valid.T):
        if known.any():
            filled[:, angle] = np.interp(frames, frames[known], series[known, angle])
    return filled


def _resampled(series: FloatArray, frames: FloatArray) -> tuple[FloatArray, BoolArray]:
    """Values (K, T, m) of a series (F, m) at frames (K, T), and where the samples on both sides are valid."""
    valid, last = np.isfinite(series), len(series) - 1
    inside = (frames >= 0.0) & (frames <= last)
    frames = np.clip(frames, 0.0, last)
    before, after = np.floor(frames).astype(np.int64), np.ceil(frames).astype(np.int64)
    observed: BoolArray = valid[before] & valid[after] & inside[:, :, None]
    return scipy.interpolate.CubicSpline(np.arange(len(series)), fill_linear(series))(frames), observed


@dataclass(frozen=True, eq=False)
class _FunctionalPca:
    """θ(ψ) = μ(ψ) + Σ_k c_k v_k(ψ) (paper B, eq. 2), sampled at T phases; every curve is a sum of 20 sinusoids.

    mean: (T, m). components: (d, T, m), orthonormal. scales: (d,), standard deviations of the coefficients c_k over
    the slices. explained: fraction of the completed slices' variance that the d components explain.
    curves: (N, 20, m), Fourier coefficients of the reconstructed slices. completed: (N, T, m), the slices with what
    was missing imputed. errors: ‖X − X₄‖ in every pass.
    """

    mean: FloatArray
    components: FloatArray
    scales: FloatArray
    explained: float
    curves: FloatArray
    completed: FloatArray
    errors: FloatArray


def fourier_basis(phases: FloatArray, n_phases: int) -> FloatArray:
    """The first 20 real Fourier functions (F, 20) at phases (F,) in cycles: 1, cos ψ, sin ψ, cos 2ψ, ….

    Orthonormal over n_phases equidistant phases, without which the iteration would not be monotone. A sum of them
    closes at the ends of the cycle with all its derivatives.
    """
    column = np.arange(N_FOURIER)
    turns = 2.0 * np.pi * phases[:, None] * ((column + 1) // 2)
    waves: FloatArray = np.where(column % 2 == 1, np.cos(turns), np.sin(turns)) * np.sqrt(2.0 / n_phases)
    waves[:, 0] = np.sqrt(1.0 / n_phases)
    return waves


def fpca_paper(slices: Slices, n_components: int = 5, tolerance: float = 1e-6) -> _FunctionalPca:
    """Functional PCA by the paper's steps 2–9: keep the q largest singular values, impute, repeat.

    Stops when ‖X − X₄‖ falls by less than the fraction `tolerance`; a warning says so when it has not after 1000
    passes. Raises InputError when there are not more slices than components.

    Deviations: the tolerance is relative, so that it does not depend on the units; the Fourier functions are real and
    orthonormal; the returned mean is projected on them too, because real cycles' row mean jumps at their ends.
    """
    _check_size(slices, n_components)
    return _fpca(slices, n_components, partial(_keep_largest, n_components), tolerance)


def fpca_shrunk(
    slices: Slices, n_components: int = 5, shrinkage: float = SHRINKAGE, tolerance: float = 1e-6
) -> _FunctionalPca:
    """Iterate with soft-thresholded singular values, around every sequence's own centre.

    Instead of keeping q singular values whole, all are lowered by `shrinkage` times the largest one of the first
    guess (Mazumder, Hastie & Tibshirani 2010: spectral regularisation), so that a rank need not be chosen and cycles
    seen only in part are not overfitted. Each sequence's mean angles, which are the person's posture rather than
    the motion, are not shrunk. The q components are those of the completed slices. Raises InputError as `fpca_paper`.
    """
    _check_size(slices, n_components)
    first = _spectra(slices.values - slices.values.mean(axis=0))
    largest = np.linalg.norm((first - _centres(first, slices)).reshape(len(first), -1), 2)
    return _fpca(slices, n_components, partial(_soften, float(shrinkage * largest), slices), tolerance)


def _fpca(
    slices: Slices, n_components: int, reconstruct: Callable[[FloatArray], tuple[FloatArray, float]], tolerance: float
) -> _FunctionalPca:
    """Steps 2–9; `reconstruct` is steps 5–6: the spectra (N, 20, m) of X − 1μᵀ in, a low rank and its penalty out."""
    n_phases = slices.values.shape[1]
    basis = fourier_basis(np.arange(n_phases) / n_phases, n_phases)
    x, complete = slices.values, bool(slices.observed.all())
    errors: list[float] = []
    for _ in tqdm(range(MOST_PASSES), desc="functional PCA", unit="pass", leave=False, disable=None):
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
        log.warning("functional PCA: not converged to %g after %d passes", tolerance, MOST_PASSES)
    mean_curve = _spectra(mean)
    spectra = _spectra(x - x.mean(axis=0))
    rows, singular = _principal(spectra.reshape(len(x), -1), n_components)
    return _FunctionalPca(
        mean=basis @ mean_curve, components=basis @ rows.reshape(n_components, N_FOURIER, -1),
        scales=singular / np.sqrt(len(x) - 1), explained=float(np.sum(singular**2) / np.sum(spectra**2)),
        curves=curves + mean_curve, completed=x, errors=np.array(errors),
    )  # fmt: skip


def _check_size(slices: Slices, n_components: int) -> None:
    most = min(len(slices.values) - 1, N_FOURIER * slices.values.shape[2])
    if not 1 <= n_components <= most:
        raise InputError(
            f"functional PCA: {len(slices.values)} slices allow 1 to {most} components, found {n_components}"
        )


def _spectra(curves: FloatArray) -> FloatArray:
    """Fourier coefficients (..., 20, m) of curves (..., T, m)."""
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
    """(N, 20, m): the constant coefficient's mean over the slices of the same sequence; nothing elsewhere."""
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
    """Spectra (N, 20, m) as N rows with some singular values only, lowered, and the sum of those.

    by_index, by_value: the squares of those to keep, by their rank in rising order or themselves. From the
    eigenvectors of the smaller of XᵀX and XXᵀ, and only those needed: many times faster than an SVD, and what is lost,
    singular values below 1e-8 of the largest, is passed over anyhow.
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
    """The first q right singular vectors (rows) and singular values of x; each vector's largest entry is positive."""
    n, size = x.shape
    if n > size:
        values, vectors = scipy.linalg.eigh(x.T @ x, subset_by_index=(size - n_components, size - 1))
        rows, singular = vectors.T[::-1], np.sqrt(np.maximum(values[::-1], 0.0))
    else:
        rows, singular = (part[:n_components] for part in np.linalg.svd(x, full_matrices=False)[:0:-1])
    largest = rows[np.arange(len(rows)), np.abs(rows).argmax(axis=1)]
    return rows * np.where(largest < 0.0, -1.0, 1.0)[:, None], singular
