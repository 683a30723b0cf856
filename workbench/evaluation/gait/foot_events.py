"""Foot strikes and toe-offs from the positions of feet and pelvis, without force plates.

A strike is found where the feet are farthest apart along the walk (Zeni, Richards & Higginson, *Gait & Posture* 27,
2008, who use the foot's distance from the sacrum), and timed where the foot's speed ahead over the ground falls to
_STRIKE_SPEED of the walking speed (a threshold on the foot's speed: Ghoussayni et al., *Gait & Posture* 20, 2004, in
proportion to the walking speed: Bruening & Ridge, *Gait & Posture* 39, 2014), as the foot is ahead most about 45 ms
before it strikes. In a walk, a toe-off is where the ankle is farthest behind (Zeni et al.), in recorded walks 17 ± 8 ms
before the toes move ahead. In a run, where the foot flies backwards after it, it is where the ankle rises fastest
(O'Connor et al., *Gait & Posture* 25, 2007, of the foot's centre), in a recorded run 29 ms after the force ends. Only
positions relative to the pelvis count along the walk, so that a treadmill and a camera that travels along make no
difference.
"""

from dataclasses import dataclass

import numpy as np
from scipy.signal import find_peaks

from workbench.evaluation.gait.stretches import Stretch
from workbench.utils.arrays import FloatArray

MIN_SEPARATION = 0.1
"""Smallest change of the distance between the feet along the walk from one step to the next, over the person's height.
Two feet side by side are closer, as in a person who stands, squats or steps in place; it is 0.8 in a usual walk."""
MIN_STRIDE_S = 0.4
"""Shortest stride; fast runners take 0.5 s."""
_STRIKE_SPEED = 0.45
"""Speed of the foot over the ground at its strike, over the walking speed: 0.26 and 0.37 of a walker, 0.28 and 0.43 of
a runner at 2.7 m/s, at the moment when the force plate shows 20 N (ankles in BMClab's recordings), and more in smooth
estimates: 0.5 in fits of one camera's noisy joints. So it is 10 to 30 ms early in recorded motion and 7 ± 18 ms late in
such fits."""
_BEFORE, _AFTER = 0.2, 0.2
"""Parts of a stride, before and after the feet are farthest apart, in which the foot is farthest ahead and strikes."""
_STANCE_FROM, _STANCE_TO = 0.1, 0.3
"""Part of the stride after the feet are farthest apart in which the foot stands, in walks and runs."""
_SWING_FROM, _SWING_TO = 0.75, 0.2
"""Part of the stride before a strike in which the toes leave the ground: 0.4 in walks, 0.65 in runs."""
_REFINED = 0.1
"""Part of a stride by which an event of a sample of the motion may differ from the expected motion's."""


@dataclass(frozen=True, eq=False)
class FootEvents:
    """n strikes of one foot in M motions and the toe-off before each, s, (M, n); NaN where it is before the stretch."""

    strikes_s: FloatArray
    toe_offs_s: FloatArray


def foot_events(stretch: Stretch, height_m: float, runs: bool) -> tuple[FootEvents, FootEvents]:
    """Return the events of left and right foot in a stretch of M motions of a person of a height, m, who walks or runs.

    They are found in the expected motion, motion 0, and timed in each, so that all have the same steps. Without two
    steps there is none.
    """
    ahead = _ahead(stretch, stretch.heels)
    apart = _farthest_apart(ahead[0, :, 0] - ahead[0, :, 1], height_m, stretch.step_s)
    if sum(map(len, apart)) < 2:
        none = np.empty((len(ahead), 0))
        return FootEvents(none, none), FootEvents(none, none)
    gaps = np.concatenate([np.diff(peaks) for peaks in apart])
    stride = float(np.median(gaps)) if len(gaps) else 2.0 * float(np.ptp(np.concatenate(apart)))
    speeds = np.gradient(ahead, axis=1)
    stance = _stance_speeds(speeds, apart, stride)
    leaving = np.gradient(stretch.ankles[..., 2], axis=1) if runs else -_ahead(stretch, stretch.ankles)
    found = []
    for foot, peaks in enumerate(apart):
        over_ground = speeds[:, :, foot] + (1.0 - _STRIKE_SPEED) * stance[:, None]
        strikes = [_strike(ahead[0, :, foot], over_ground, int(peak), stride) for peak in peaks]
        offs = [_toe_off(leaving[:, :, foot], float(strike[0]), stride) for strike in strikes]
        frames = [np.stack(each, axis=1) if each else np.empty((len(ahead), 0)) for each in (strikes, offs)]
        found.append(FootEvents(*(stretch.times_s[0] + stretch.step_s * each for each in frames)))
    return found[0], found[1]


def _ahead(stretch: Stretch, points: FloatArray) -> FloatArray:
    """Return the distances (M, F, 2), m, of points of the feet (M, F, 2, 3) ahead of the pelvis."""
    offsets = points - stretch.pelvis[:, :, None]
    return np.asarray((offsets[..., :2] * stretch.facing[:, :, None]).sum(axis=-1))


def _farthest_apart(separation: FloatArray, height_m: float, step_s: float) -> list[FloatArray]:
    """Return the frames in which the left foot, and the right one, is farthest ahead of the other, from the distance
    (F,), m, of the left foot ahead of the right one."""
    least_m, apart = MIN_SEPARATION * height_m, max(MIN_STRIDE_S / step_s, 1.0)
    signed = (separation, -separation)
    return [find_peaks(each, prominence=least_m, distance=apart)[0].astype(np.float64) for each in signed]


def _stance_speeds(speeds: FloatArray, apart: list[FloatArray], stride: float) -> FloatArray:
    """Return the walking speeds (M,), m per frame, from those of the feet relative to the pelvis (M, F, 2): the median
    of feet that stand."""
    standing = []
    for foot, peaks in enumerate(apart):
        for peak in peaks:
            first, end = (round(peak + part * stride) for part in (_STANCE_FROM, _STANCE_TO))
            standing.append(speeds[:, first : end + 1, foot])
    return np.asarray(-np.median(np.concatenate(standing, axis=1), axis=1))


def _strike(ahead: FloatArray, over_ground: FloatArray, peak: int, stride: float) -> FloatArray:
    """Return the frames (M,), not whole, of a strike: after the foot is farthest ahead (F,) in the expected motion, its
    speed over the ground (M, F) falls below a threshold, here 0."""
    first, end = max(round(peak - _BEFORE * stride), 0), round(peak + _AFTER * stride) + 1
    farthest = first + int(np.argmax(ahead[first:end]))
    expected = _falls_below(over_ground[:1], farthest, farthest, end)[0]
    reach = _REFINED * stride
    return _falls_below(over_ground, expected, round(expected - reach), round(expected + reach) + 1)


def _falls_below(values: FloatArray, near: float, first: int, end: int) -> FloatArray:
    """Return where values (M, F) fall below 0 within [first, end), nearest to a frame, by linear interpolation; where
    they do not, where they are nearest to 0."""
    first, end = max(first, 0), min(max(end, first + 2), values.shape[1])
    part = values[:, first:end]
    before, after = part[:, :-1], part[:, 1:]
    falls = (before >= 0.0) & (after < 0.0)
    places = first + np.arange(before.shape[1]) + before / np.where(falls, before - after, 1.0)
    nearest = np.argmin(np.where(falls, np.abs(places - near), np.inf), axis=1)[:, None]
    crossing = np.take_along_axis(places, nearest, axis=1)[:, 0]
    return np.where(falls.any(axis=1), crossing, first + np.argmin(np.abs(part), axis=1))


def _toe_off(leaving: FloatArray, strike: float, stride: float) -> FloatArray:
    """Return the frames (M,), not whole, in which a measure of leaving the ground (M, F) is largest before a strike;
    NaN at the stretch's begin."""
    first, end = max(round(strike - _SWING_FROM * stride), 0), round(strike - _SWING_TO * stride) + 1
    unknown = np.full(len(leaving), np.nan)
    if end - first < 3:
        return unknown
    expected = first + int(np.argmax(leaving[0, first:end]))
    if expected == 0:
        return unknown
    reach = max(round(_REFINED * stride), 1)
    return _maximum(leaving, max(expected - reach, 0), min(expected + reach + 1, leaving.shape[1]))


def _maximum(values: FloatArray, first: int, end: int) -> FloatArray:
    """Return where values (M, F) are largest within [first, end), by a parabola through three frames."""
    place = first + np.argmax(values[:, first:end], axis=1)
    inside = np.clip(place, 1, values.shape[1] - 2)
    before, at, after = (np.take_along_axis(values, (inside + k)[:, None], axis=1)[:, 0] for k in (-1, 0, 1))
    curvature = before - 2.0 * at + after
    shift = np.where(curvature < 0.0, 0.5 * (before - after) / np.where(curvature < 0.0, curvature, 1.0), 0.0)
    return np.where(place == inside, inside + np.clip(shift, -0.5, 0.5), place)
