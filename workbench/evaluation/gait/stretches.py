"""Stretches of frames without gaps, at one rate, of the points by which a walk is measured."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import scipy
from scipy.ndimage import uniform_filter1d

from workbench.body.stature import SIDES
from workbench.utils.arrays import BoolArray, FloatArray, IntArray

MAX_GAP_S = 0.15
"""Longest interval between two frames of a stretch. A swinging foot reverses in a tenth of a stride of 1 to 1.5 s, so
that frames farther apart do not show when."""
CUTOFF_HZ = 6.0
"""Cut-off of the low-pass filter: the usual one of the positions of markers in gait (Winter, *Biomechanics and Motor
Control of Human Movement*, 4th ed. 2009, section 3.4)."""
_MIN_RATE_HZ = 2.5 * CUTOFF_HZ
"""Rate from which on positions are filtered; a lower one has little above the cut-off."""
_UNEVEN_S = 1.5e-3
"""Largest deviation of even times; Matroska rounds times to whole milliseconds."""
_FACING_S = 1.0
"""Time over which the direction of the pelvis is averaged, about a stride, in which it turns to both sides."""
_POINTS = ("pelvis", *(f"{side}_{joint}" for joint in ("hip", "ankle", "heel") for side in SIDES))


@dataclass(frozen=True, eq=False)
class Stretch:
    """F frames at one rate of M motions, low-passed; motion 0 is the expected one.

    times_s: (F,), s, even. pelvis: (M, F, 3), m. ankles: (M, F, 2, 3), m, left and right. heels: (M, F, 2, 3), m, or
    the ankles of a body without heels. facing: (M, F, 2), horizontal unit vectors ahead. angles: (M, F, A), rad, not
    low-passed.
    """

    times_s: FloatArray
    pelvis: FloatArray
    ankles: FloatArray
    heels: FloatArray
    facing: FloatArray
    angles: FloatArray

    @property
    def step_s(self) -> float:
        """Interval between two frames, s."""
        return float(self.times_s[1] - self.times_s[0])

    def at(self, values: FloatArray, times_s: FloatArray) -> FloatArray:
        """Return values (M, F, ...) at n times of each motion (M, n), s, by linear interpolation: (M, n, ...)."""
        last = len(self.times_s) - 1
        place = np.clip((times_s - self.times_s[0]) / self.step_s, 0.0, last)
        before = np.minimum(place.astype(np.int64), last - 1)
        share = (place - before).reshape(*place.shape, *([1] * (values.ndim - 2)))
        motions = np.arange(len(values))[:, None]
        return np.asarray((1.0 - share) * values[motions, before] + share * values[motions, before + 1])


def rows_of_stretches(times_s: FloatArray, valid: BoolArray, max_gap_s: float = MAX_GAP_S) -> list[IntArray]:
    """Return the valid frames (F,) of each stretch of two frames or more, at times (F,), s, at most max_gap_s apart."""
    rows = np.flatnonzero(valid)
    ends = np.flatnonzero(np.diff(times_s[rows]) > max_gap_s * (1.0 + 1e-9)) + 1
    return [stretch for stretch in np.split(rows, ends) if len(stretch) > 1]


def stretch_of(
    names: Sequence[str], joints: FloatArray, angles: FloatArray, times_s: FloatArray, rows: IntArray
) -> Stretch:
    """Return a stretch of motions at the median rate of its frames.

    Parameters
    ----------
    names : of the J joints, JOINT_NAMES and possibly heels and toes.
    joints : (M, F, J, 3), m, in the world, z up.
    angles : (M, F, A), rad.
    times_s : (F,), s, increasing.
    rows : (n,), the frames of the stretch.
    """
    points = [name for name in _POINTS if name in names]
    chosen = joints[:, rows][:, :, [names.index(name) for name in points]]
    times_s, (chosen, angles) = evenly(times_s[rows], chosen, angles[:, rows])
    rate_hz = 1.0 / float(times_s[1] - times_s[0])
    smooth = dict(zip(points, np.moveaxis(low_passed(chosen, rate_hz), 2, 0), strict=True))
    ankles = np.stack([smooth[f"{side}_ankle"] for side in SIDES], axis=2)
    heels = [smooth[f"{side}_heel"] for side in SIDES if f"{side}_heel" in smooth]
    across = (smooth["left_hip"] - smooth["right_hip"])[..., :2]
    ahead = np.stack([across[..., 1], -across[..., 0]], axis=-1)
    ahead = uniform_filter1d(ahead, max(round(_FACING_S * rate_hz), 1), axis=1, mode="nearest")
    facing = ahead / np.maximum(np.linalg.norm(ahead, axis=-1, keepdims=True), 1e-12)
    strikers = np.stack(heels, axis=2) if len(heels) == len(SIDES) else ankles
    return Stretch(times_s, smooth["pelvis"], ankles, strikers, facing, angles)


def evenly(times_s: FloatArray, *values: FloatArray) -> tuple[FloatArray, list[FloatArray]]:
    """Return even times (G,), s, and values (M, G, ...) at them, by cubic splines where the times (F,) of the values
    (M, F, ...) are uneven."""
    n = len(times_s)
    even_s = np.linspace(times_s[0], times_s[-1], n)
    if np.abs(even_s - times_s).max() <= _UNEVEN_S:
        return even_s, list(values)
    step_s = float(np.median(np.diff(times_s)))
    even_s = np.linspace(times_s[0], times_s[-1], max(round((times_s[-1] - times_s[0]) / step_s) + 1, 2))
    return even_s, [np.asarray(scipy.interpolate.CubicSpline(times_s, each, axis=1)(even_s)) for each in values]


def low_passed(values: FloatArray, rate_hz: float) -> FloatArray:
    """Return values (M, F, ...) low-passed at CUTOFF_HZ without delay, unchanged at rates below _MIN_RATE_HZ."""
    if rate_hz < _MIN_RATE_HZ:
        return values
    sections = scipy.signal.butter(2, CUTOFF_HZ, fs=rate_hz, output="sos")
    return np.asarray(scipy.signal.sosfiltfilt(sections, values, axis=1, padlen=min(9, values.shape[1] - 1)))
