"""Measures of any motion: range, peak angular speed and repetitions of each joint angle."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import scipy

from workbench.evaluation.gait.stretches import evenly, low_passed
from workbench.utils.arrays import FloatArray, IntArray

MIN_RANGE_RAD = np.radians(20.0)
"""Smallest range of a joint angle that repeats; noise and sway of a person who stands are smaller."""
REPEATED = 0.5
"""Part of an angle's range by which it changes in a repetition."""


@dataclass(frozen=True, eq=False)
class AngleMeasures:
    """Measures of A angles in M motions.

    ranges_rad, peak_speeds_rad_s: (M, A). repetitions: (A,), in the expected motion. seconds: (M, A), mean time from
    one repetition to the next, NaN for fewer than two.
    """

    ranges_rad: FloatArray
    peak_speeds_rad_s: FloatArray
    repetitions: IntArray
    seconds: FloatArray


def angle_measures(times_s: FloatArray, angles: FloatArray, stretches: Sequence[IntArray]) -> AngleMeasures:
    """Return the measures of angles (M, F, A), rad, at times (F,), s, in stretches of frames.

    Speeds and repetitions are of the low-passed angles within stretches of three frames or more. A repetition is a
    maximum of an angle with a range of MIN_RANGE_RAD, from which it falls by REPEATED of the range before and after, or
    the stretch begins or ends.
    """
    n_motions, _, n_angles = angles.shape
    rows = np.concatenate([np.empty(0, np.int64), *stretches])
    if not len(rows):
        unknown = np.full((n_motions, n_angles), np.nan)
        return AngleMeasures(unknown, unknown, np.zeros(n_angles, np.int64), unknown)
    ranges = np.ptp(angles[:, rows], axis=1)
    peak_speeds = np.full((n_motions, n_angles), np.nan)
    counts = np.zeros(n_angles, np.int64)
    totals, n_times = np.zeros((n_motions, n_angles)), np.zeros(n_angles)
    for stretch in stretches:
        if len(stretch) < 3:
            continue
        even_s, (values,) = evenly(times_s[stretch], angles[:, stretch])
        step_s = float(even_s[1] - even_s[0])
        smooth = low_passed(values, 1.0 / step_s)
        peak_speeds = np.fmax(peak_speeds, np.abs(np.gradient(smooth, step_s, axis=1)).max(axis=1))
        for k in np.flatnonzero(ranges[0] >= MIN_RANGE_RAD):
            peaks = _repetitions(smooth[0, :, k], REPEATED * float(ranges[0, k]))
            counts[k] += len(peaks)
            if len(peaks) > 1:
                reach = max(round(0.25 * float(np.diff(peaks).min())), 1)
                first, last = (_peak(smooth[:, :, k], int(peak), reach) for peak in peaks[[0, -1]])
                totals[:, k] += (last - first) * step_s
                n_times[k] += len(peaks) - 1
    seconds = np.where(n_times > 0, totals / np.maximum(n_times, 1), np.nan)
    return AngleMeasures(ranges, peak_speeds, counts, seconds)


def _repetitions(angle: FloatArray, least: float) -> IntArray:
    """Return the frames of maxima of an angle (F,) which falls by `least` before and after, or begins or ends."""
    peaks = scipy.signal.find_peaks(np.pad(angle, 1, constant_values=-np.inf), prominence=least)[0] - 1
    return np.asarray(peaks[(peaks > 0) & (peaks < len(angle) - 1)], dtype=np.int64)


def _peak(values: FloatArray, near: int, reach: int) -> FloatArray:
    """Return the frames (M,) of the largest values (M, F) within `reach` frames of one."""
    first = max(near - reach, 0)
    return np.asarray(first + np.argmax(values[:, first : near + reach + 1], axis=1), dtype=np.float64)
