"""Filling gaps in cyclic sequences: by interpolation, from the sequence's own cycle, and by functional PCA."""

from collections.abc import Sequence

import numpy as np
import scipy

from workbench.motion.models.cycle_alignment import Alignment, fit_periodic, periodic_basis
from workbench.motion.models.functional_pca import Slices, cut, fill_linear, fourier_basis, fpca_paper, fpca_shrunk
from workbench.utils.arrays import FloatArray

PERIODIC_KNOTS = 16
ROUGHNESS = 1.0


def impute(sequences: Sequence[FloatArray], alignment: Alignment) -> list[FloatArray]:
    """Fill every NaN of sequences (F_i, m); valid samples stay as they are.

    Where a sample is missing: `fpca_shrunk` over the cycles of all sequences, plus what it leaves unexplained in the
    valid samples before and after, interpolated across the gap. Raises InputError as `cut` and `fpca_paper` do.
    """
    slices = cut(sequences, alignment)
    models = reconstructed(sequences, alignment, slices, fpca_shrunk(slices, 1).curves)
    pairs = zip(sequences, models, strict=True)
    return [_filled(series, model + fill_smooth(series - model)) for series, model in pairs]


def impute_paper(sequences: Sequence[FloatArray], alignment: Alignment) -> list[FloatArray]:
    """Impute by the paper's plain algorithm: the reconstruction of `fpca_paper`, nothing else."""
    slices = cut(sequences, alignment)
    models = reconstructed(sequences, alignment, slices, fpca_paper(slices).curves)
    return [_filled(series, model) for series, model in zip(sequences, models, strict=True)]


def impute_periodic(sequences: Sequence[FloatArray], alignment: Alignment) -> list[FloatArray]:
    """Impute from each sequence alone: a periodic smoothing spline, plus the interpolated residual."""
    filled = []
    for i, series in enumerate(sequences):
        basis = periodic_basis(alignment.phases(i, len(series)), PERIODIC_KNOTS)
        valid = np.isfinite(series)
        mean = np.where(valid, series, 0.0).sum(axis=0) / np.maximum(valid.sum(axis=0), 1)
        centred = np.where(valid, series - mean, 0.0)
        model = mean + basis @ fit_periodic(basis, valid.astype(np.float64), centred, ROUGHNESS)
        filled.append(_filled(series, model + fill_smooth(series - model)))
    return filled


def impute_linear(sequences: Sequence[FloatArray]) -> list[FloatArray]:
    """Impute by linear interpolation in time."""
    return [fill_linear(series) for series in sequences]


def fill_smooth(series: FloatArray) -> FloatArray:
    """Series (F, m) with gaps filled by monotone cubic interpolation in time, constant beyond the ends."""
    filled = fill_linear(series)
    frames = np.arange(len(series))
    for angle, known in enumerate(np.isfinite(series).T):
        if 1 < known.sum() < len(series):
            inside = ~known & (frames > frames[known][0]) & (frames < frames[known][-1])
            filled[inside, angle] = scipy.interpolate.PchipInterpolator(frames[known], series[known, angle])(
                frames[inside]
            )
    return filled


def reconstructed(
    sequences: Sequence[FloatArray], alignment: Alignment, slices: Slices, curves: FloatArray
) -> list[FloatArray]:
    """Sequences (F_i, m) at every frame, from the Fourier coefficients (N, 20, m) of their slices."""
    models = []
    for i, series in enumerate(sequences):
        phases = alignment.phases(i, len(series))
        basis = fourier_basis(phases, slices.values.shape[1])
        cycles = np.floor(phases).astype(np.int64)
        model = np.empty_like(series)
        for row in np.flatnonzero(slices.sequence == i):
            here = cycles == slices.cycle[row]
            model[here] = basis[here] @ curves[row]
        models.append(model)
    return models


def _filled(series: FloatArray, guess: FloatArray) -> FloatArray:
    return np.where(np.isfinite(series), series, guess)
