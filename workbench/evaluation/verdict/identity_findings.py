"""Findings on the identity of the person in the keypoints: whether another person replaces the first one."""

from collections.abc import Iterator

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view

from workbench.body.skeleton import JOINT_NAMES
from workbench.body.stature import LIMBS, SIDES
from workbench.cameras.observed_joints import MIN_WEIGHT, some_frames
from workbench.cameras.triangulation import triangulate
from workbench.evaluation.verdict.run_measurements import RunMeasurements
from workbench.utils.arrays import FloatArray
from workbench.utils.finding import Finding
from workbench.utils.nan_statistics import nan_median

_WINDOW_S, _MIN_FRAMES = 0.25, 3
"""Time over which lengths in the image are averaged before and after a frame, half a step of a walk."""
_MAX_IN_IMAGE, _MAX_RATE = 0.1, 0.6
"""Change of the logarithm of the lengths in the image: by posture and the detector's error, and per second of a person
who runs towards a camera, at 3 m/s and 5 m."""
_WINDOW_3D_S, _MAX_IN_SPACE = 0.5, 0.1
"""The same for triangulated lengths, which only change by the detector's error, up to 4 % in half a second. Heights of
adults differ by 5 % (one standard deviation), so that many other persons are not distinguished by this."""
_SERIES_FRAMES = 500
_ENDS = [*LIMBS.values(), ("shoulder", "hip")]


def identity_findings(measured: RunMeasurements) -> Iterator[Finding]:
    """Yield a sudden change of the person's size, in space with several cameras, else in the image."""
    observed, times_s = measured.observed, measured.times_s
    if not measured.has_keypoints or len(times_s) < 2 or (np.diff(times_s) <= 0.0).any():
        return
    if len(observed.cameras) > 1:
        rows = some_frames(len(times_s), _SERIES_FRAMES)
        joints = triangulate(observed.cameras, observed.pixels(MIN_WEIGHT)[:, rows])
        change, t = _change_of_size(joints, times_s[rows], _WINDOW_3D_S)
        numbers, limit = measured.frames[rows], _MAX_IN_SPACE
    else:
        (joints,) = observed.pixels(MIN_WEIGHT)
        change, t = _change_of_size(joints, times_s, _WINDOW_S)
        numbers, limit = measured.frames, _MAX_IN_IMAGE + _MAX_RATE * _window_s(times_s, _WINDOW_S)
    if abs(change) > limit:
        how = f"{abs(np.expm1(change)):.0%} {'larger' if change > 0.0 else 'smaller'}"
        text = f"the person is {how} from frame {numbers[t]} on: another person replaces the first one"
        yield Finding("change of person", text)


def _change_of_size(joints: FloatArray, times_s: FloatArray, window_s: float) -> tuple[float, int]:
    """Return the largest change of the logarithm of the limbs' lengths, of joints (F, J, 2 or 3), between a window
    before and one after a frame, the median over limbs, and that frame; 0 for short clips."""
    n = _window(times_s, window_s)
    pairs = [(_index(side, a), _index(side, b)) for a, b in _ENDS for side in SIDES]
    lengths = np.stack([np.linalg.norm(joints[:, a] - joints[:, b], axis=1) for a, b in pairs], axis=1)
    if len(lengths) < 2 * n:
        return 0.0, 0
    windows = nan_median(sliding_window_view(np.log(np.maximum(lengths, 1e-9)), n, axis=0))  # (F - n + 1, limbs)
    changes = np.nan_to_num(nan_median(windows[n:] - windows[:-n]))
    t = int(np.argmax(np.abs(changes)))
    return float(changes[t]), t + n


def _window(times_s: FloatArray, window_s: float) -> int:
    """Return the number of frames of a window."""
    return max(_MIN_FRAMES, round(window_s / float(np.median(np.diff(times_s)))))


def _window_s(times_s: FloatArray, window_s: float) -> float:
    """Return the duration of a window of whole frames, s."""
    return _window(times_s, window_s) * float(np.median(np.diff(times_s)))


def _index(side: str, name: str) -> int:
    return JOINT_NAMES.index(f"{side}_{name}")
