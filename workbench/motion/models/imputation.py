"""Gaps in cyclic sequences: removal of samples, and imputation by interpolation, cyclic fits and functional PCA."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import scipy

from workbench.body.skeleton import N_ROOT, POSE_NAMES
from workbench.motion.models.cycle_alignment import CycleAlignment, fit_periodic, periodic_basis
from workbench.motion.models.functional_pca import Slices, cut, fill_linear, fourier_basis, fpca_paper, fpca_shrunk
from workbench.motion.pose_sequence import Motion
from workbench.utils.arrays import BoolArray, FloatArray

PERIODIC_KNOTS = 16
ROUGHNESS = 1.0
BLOCK_S = (0.1, 0.5)  # shortest and longest block removed, s: 12 to 60 frames at 120 Hz


def remove_blocks(motion: Motion, fraction: float, rng: np.random.Generator) -> BoolArray:
    """Return a random mask (F, 19) of joint angles to remove: blocks per angle, up to the fraction."""
    removed = np.zeros((len(motion), len(POSE_NAMES) - N_ROOT), dtype=bool)
    for angle in removed.T:
        while angle.mean() < fraction:
            length = min(len(motion), round(rng.uniform(*BLOCK_S) * motion.rate_hz))
            start = rng.integers(len(motion) - length + 1)
            angle[start : start + length] = True
    return removed


def with_gaps(motion: Motion, fraction: float, rng: np.random.Generator) -> Motion:
    """Return the motion with a fraction of its joint angles missing (NaN), in blocks."""
    poses = motion.poses.copy()
    poses[:, N_ROOT:][remove_blocks(motion, fraction, rng)] = np.nan
    return replace(motion, poses=poses)


def impute(sequences: Sequence[FloatArray], alignment: CycleAlignment) -> list[FloatArray]:
    """Return sequences (F_i, m) with every NaN imputed; valid samples are unchanged.

    A missing sample is the reconstruction of `fpca_shrunk` over the cycles of all sequences, plus its residual at the
    valid samples before and after, interpolated across the gap. Raises InputError as `cut` and `fpca_paper`.
    """
    slices = cut(sequences, alignment)
    models = _reconstructed(sequences, alignment, slices, fpca_shrunk(slices, 1).curves)
    pairs = zip(sequences, models, strict=True)
    return [_filled(series, model + fill_smooth(series - model)) for series, model in pairs]


def impute_paper(sequences: Sequence[FloatArray], alignment: CycleAlignment) -> list[FloatArray]:
    """Return sequences imputed by the paper's algorithm: the reconstruction of `fpca_paper` alone."""
    slices = cut(sequences, alignment)
    models = _reconstructed(sequences, alignment, slices, fpca_paper(slices).curves)
    return [_filled(series, model) for series, model in zip(sequences, models, strict=True)]


def impute_periodic(sequences: Sequence[FloatArray], alignment: CycleAlignment) -> list[FloatArray]:
    """Return each sequence imputed by its periodic smoothing spline, plus the interpolated residual."""
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
    """Return sequences imputed by linear interpolation in time."""
    return [fill_linear(series) for series in sequences]


def fill_smooth(series: FloatArray) -> FloatArray:
    """Return a series (F, m) with gaps filled by monotone cubic interpolation in time, constant beyond the ends."""
    filled = fill_linear(series)
    frames = np.arange(len(series))
    for angle, valid in enumerate(np.isfinite(series).T):
        if 1 < valid.sum() < len(series):
            inside = ~valid & (frames > frames[valid][0]) & (frames < frames[valid][-1])
            filled[inside, angle] = scipy.interpolate.PchipInterpolator(frames[valid], series[valid, angle])(
                frames[inside]
            )
    return filled


def _reconstructed(
    sequences: Sequence[FloatArray], alignment: CycleAlignment, slices: Slices, curves: FloatArray
) -> list[FloatArray]:
    """Return the sequences (F_i, m) at every frame from the Fourier coefficients (N, 20, m) of their slices."""
    models = []
    for i, series in enumerate(sequences):
        phases = alignment.phases(i, len(series))
        basis = fourier_basis(phases, slices.values.shape[1])
        cycles = np.floor(phases).astype(np.int64)
        model = np.empty_like(series)
        for row in np.flatnonzero(slices.sequence == i):
            in_cycle = cycles == slices.cycle[row]
            model[in_cycle] = basis[in_cycle] @ curves[row]
        models.append(model)
    return models


def _filled(series: FloatArray, guess: FloatArray) -> FloatArray:
    return np.where(np.isfinite(series), series, guess)
