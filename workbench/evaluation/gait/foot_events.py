"""Foot strikes and toe-offs from the positions of feet and pelvis, without force plates.

A strike follows, by _STRIKE_DELAY, the moment when the foot is farthest ahead of the pelvis (Zeni, Richards &
Higginson, *Gait & Posture* 27, 2008). In a walk, a toe-off is where the ankle is farthest behind (Zeni et al.), in
recorded walks 17 ± 8 ms before the toes move ahead. In a run, where the foot flies backwards after it, it is where the
ankle rises fastest (O'Connor et al., *Gait & Posture* 25, 2007, of the foot's centre), in a recorded run 29 ms after
the force ends. Only positions relative to the pelvis count along the walk, so that a treadmill and a camera that
travels along make no difference.
"""

from dataclasses import dataclass

import numpy as np
import scipy

from workbench.evaluation.gait.stretches import Stretch
from workbench.utils.arrays import FloatArray

MIN_SEPARATION = 0.1
"""Smallest change of the distance between the feet along the walk from one step to the next, over the person's height.
Two feet side by side are closer, as in a person who stands, squats or steps in place; it is 0.8 in a usual walk."""
MIN_STRIDE_S = 0.4
"""Shortest stride; fast runners take 0.5 s."""
_STRIKE_DELAY = 0.045
"""Time from the moment when the foot is farthest ahead to its strike, over the stride's: 43 and 52 ms of a walker with
strides of 0.97 s, 38 ms of a runner with strides of 0.69 s, to the moment when the force plate shows 20 N (ankles in
BMClab's recordings). A threshold on the foot's speed needs no delay, but smooth estimates cross it later: 38 ms in fits
of one camera's noisy joints, which are farthest ahead 13 ms later than the recorded motion."""
_AROUND = 0.2
"""Part of a stride, before and after the feet are farthest apart, in which the foot is farthest ahead."""
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
    farthest = _largest_separations(ahead[0, :, 0] - ahead[0, :, 1], height_m, stretch.step_s)
    if sum(map(len, farthest)) < 2:
        none = np.empty((len(ahead), 0))
        return FootEvents(none, none), FootEvents(none, none)
    gaps = np.concatenate([np.diff(peaks) for peaks in farthest])
    stride = float(np.median(gaps)) if len(gaps) else 2.0 * float(np.ptp(np.concatenate(farthest)))
    leaving = np.gradient(stretch.ankles[..., 2], axis=1) if runs else -_ahead(stretch, stretch.ankles)
    found = []
    for foot, peaks in enumerate(farthest):
        strikes = [_strike(ahead[:, :, foot], int(peak), stride) for peak in peaks]
        offs = [_toe_off(leaving[:, :, foot], float(strike[0]), stride) for strike in strikes]
        frames = [np.stack(each, axis=1) if each else np.empty((len(ahead), 0)) for each in (strikes, offs)]
        found.append(FootEvents(*(stretch.times_s[0] + stretch.step_s * each for each in frames)))
    return found[0], found[1]


def _ahead(stretch: Stretch, points: FloatArray) -> FloatArray:
    """Return the distances (M, F, 2), m, of points of the feet (M, F, 2, 3) ahead of the pelvis."""
    offsets = points - stretch.pelvis[:, :, None]
    return np.asarray((offsets[..., :2] * stretch.facing[:, :, None]).sum(axis=-1))


def _largest_separations(separation: FloatArray, height_m: float, step_s: float) -> list[FloatArray]:
    """Return the frames in which the left foot, and the right one, is farthest ahead of the other, from the distance
    (F,), m, of the left foot ahead of the right one."""
    least_m, least = MIN_SEPARATION * height_m, max(MIN_STRIDE_S / step_s, 1.0)
    signed = (separation, -separation)
    return [scipy.signal.find_peaks(each, prominence=least_m, distance=least)[0].astype(np.float64) for each in signed]


def _strike(ahead: FloatArray, peak: int, stride: float) -> FloatArray:
    """Return the frames (M,), not whole, of a strike, from the distance of the foot ahead of the pelvis (M, F), near
    the frame in which the feet are farthest apart."""
    first = max(round(peak - _AROUND * stride), 0)
    expected = first + int(np.argmax(ahead[0, first : round(peak + _AROUND * stride) + 1]))
    return _near_maximum(ahead, expected, stride) + _STRIKE_DELAY * stride


def _toe_off(leaving: FloatArray, strike: float, stride: float) -> FloatArray:
    """Return the frames (M,), not whole, in which a measure of leaving the ground (M, F) is largest before a strike;
    NaN at the stretch's begin."""
    first, end = max(round(strike - _SWING_FROM * stride), 0), round(strike - _SWING_TO * stride) + 1
    unknown = np.full(len(leaving), np.nan)
    if end - first < 3:
        return unknown
    expected = first + int(np.argmax(leaving[0, first:end]))
    return unknown if expected == 0 else _near_maximum(leaving, expected, stride)


def _near_maximum(values: FloatArray, expected: int, stride: float) -> FloatArray:
    """Return where values (M, F) are largest within _REFINED of a stride from a frame, by a parabola."""
    reach = max(round(_REFINED * stride), 1)
    first = max(expected - reach, 0)
    place = first + np.argmax(values[:, first : expected + reach + 1], axis=1)
    inside = np.clip(place, 1, values.shape[1] - 2)
    before, at, after = (np.take_along_axis(values, (inside + k)[:, None], axis=1)[:, 0] for k in (-1, 0, 1))
    curvature = before - 2.0 * at + after
    shift = np.where(curvature < 0.0, 0.5 * (before - after) / np.where(curvature < 0.0, curvature, 1.0), 0.0)
    return np.where(place == inside, inside + np.clip(shift, -0.5, 0.5), place)
