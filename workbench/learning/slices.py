"""Slices: sequences with gaps cut into cycles and resampled to common phases (paper B, section 2.2, step 1)."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.interpolate import CubicSpline

from workbench.arrays import BoolArray, FloatArray, IntArray
from workbench.errors import InputError
from workbench.learning.alignment import Alignment


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


def cut(sequences: Sequence[FloatArray], alignment: Alignment, n_phases: int = 64) -> Slices:
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
    return CubicSpline(np.arange(len(series)), fill_linear(series))(frames), observed
