"""Findings on the identity of the person in the keypoints: whether another person replaces the first one."""

from collections.abc import Iterator

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from scipy.ndimage import find_objects, label

from workbench.body.skeleton import joint_of
from workbench.body.stature import LIMBS, SIDES
from workbench.cameras.observed_joints import MIN_WEIGHT, some_frames
from workbench.cameras.triangulation import triangulate
from workbench.evaluation.verdict.run_measurements import RunMeasurements
from workbench.utils.arrays import BoolArray, FloatArray
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
    """Yield the most sudden change of the person's size, in space with several cameras, else in the image."""
    changes = _changes(measured)
    if changes:
        change, t = max(changes, key=lambda each: abs(each[0]))
        how = f"{abs(np.expm1(change)):.0%} {'larger' if change > 0.0 else 'smaller'}"
        text = f"the person is {how} from frame {measured.frames[t]} on: another person replaces the first one"
        yield Finding("change of person", text)


def another_person(measured: RunMeasurements) -> BoolArray:
    """Return in which frames (F,) the keypoints are of another person than in the first ones: from a change of the size
    to the next one in the opposite direction."""
    another: BoolArray = np.zeros(len(measured.times_s), dtype=bool)
    sign = 0.0  # of the change from the first person to the one who is shown, 0 for the first one
    for change, t in _changes(measured):
        sign = 0.0 if sign == -np.sign(change) else np.sign(change)
        another[t:] = sign != 0.0
    return another


def _changes(measured: RunMeasurements) -> list[tuple[float, int]]:
    """Return the sudden changes of the logarithm of the person's size, and the rows of their frames, in order."""
    observed, times_s = measured.observed, measured.times_s
    if not measured.has_keypoints or len(times_s) < 2 or (np.diff(times_s) <= 0.0).any():
        return []
    pixels = observed.pixels(MIN_WEIGHT)
    if len(observed.cameras) > 1:
        rows = np.arange(len(times_s))[some_frames(len(times_s), _SERIES_FRAMES)]
        joints = triangulate(observed.cameras, pixels[:, rows])
        n, limit = _window(times_s[rows], _WINDOW_3D_S), _MAX_IN_SPACE
    else:
        rows, joints = np.arange(len(times_s)), pixels[0]
        n = _window(times_s, _WINDOW_S)
        limit = _MAX_IN_IMAGE + _MAX_RATE * n * float(np.median(np.diff(times_s)))
    sizes = _changes_of_size(joints, n)
    sudden = label(sizes > limit)[0], label(sizes < -limit)[0]
    peaks = [each.start + int(np.argmax(np.abs(sizes[each]))) for labels in sudden for (each,) in find_objects(labels)]
    return [(float(sizes[peak]), int(rows[peak + n])) for peak in sorted(peaks)]


def _changes_of_size(joints: FloatArray, n: int) -> FloatArray:
    """Return the changes (F - 2 n + 1,) of the logarithm of the limbs' lengths, of joints (F, J, 2 or 3), between a
    window of n frames before and one from a frame on, the median over limbs; 0 for short clips."""
    pairs = [[joint_of(joints, f"{side}_{end}") for end in ends] for ends in _ENDS for side in SIDES]
    lengths = np.stack([np.linalg.norm(a - b, axis=1) for a, b in pairs], axis=1)
    if len(lengths) < 2 * n:
        return np.zeros(1)
    windows = nan_median(sliding_window_view(np.log(np.maximum(lengths, 1e-9)), n, axis=0))  # (F - n + 1, limbs)
    return np.asarray(np.nan_to_num(nan_median(windows[n:] - windows[:-n])))


def _window(times_s: FloatArray, window_s: float) -> int:
    return max(_MIN_FRAMES, round(window_s / float(np.median(np.diff(times_s)))))
