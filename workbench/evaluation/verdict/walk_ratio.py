"""The walk ratio, step length over cadence, by which a walk shows the rate of its frames."""

from dataclasses import dataclass

import numpy as np

from workbench.body.skeleton import joint_of
from workbench.utils.arrays import FloatArray

_MIN_SEPARATION, _MIN_STEP = 0.1, 0.1
"""Distance of the ankles along the walk between two crossings, and of the pelvis' places at them, in heights: two feet
side by side are closer, and a person who steps in place moves by less. A step of a walk is 0.4."""
_MIN_STEPS = 3
_USUAL, _HEIGHT_M = 0.0065, 1.7
"""Walk ratio, m per step/min, of adults, and their height."""


@dataclass(frozen=True)
class Steps:
    """Steps of a walk, medians. length_m: between the crossings of the ankles. cadence_per_min: steps per minute.
    relative_ratio: walk ratio over the usual one of a person of the same height."""

    length_m: float
    cadence_per_min: float
    relative_ratio: float


def steps_of(joints: FloatArray, times_s: FloatArray, height_m: float) -> Steps | None:
    """Return the steps of a person, None for less than _MIN_STEPS.

    The ratio of step length and cadence is about 0.0065 m per step/min for adults at all speeds above 1 m/s (Sekiya &
    Nagasaki, *Gait & Posture* 7, 1998), higher for slower ones (Murakami & Otaka, *J. Phys. Ther. Sci.* 29, 2017), and
    nearly the same in runs. Lengths are in proportion to the height h and durations to its root, as those of pendulums,
    so that it is proportional to h^1.5. With times that are k times as long, it is k times as large.

    Parameters
    ----------
    joints : (F, J, 3), m, in the order of JOINT_NAMES.
    times_s : (F,), s.
    height_m : the person's.
    """
    across = joint_of(joints, "left_hip") - joint_of(joints, "right_hip")
    ahead = np.column_stack([across[:, 1], -across[:, 0]])
    ankles = (joint_of(joints, "left_ankle") - joint_of(joints, "right_ankle"))[:, :2]
    separation = (ankles * ahead).sum(axis=1) / np.maximum(np.linalg.norm(ahead, axis=1), 1e-12)
    crossings = _crossings(separation, _MIN_SEPARATION * height_m)
    places = np.array([np.interp(crossings, np.arange(len(times_s)), joints[:, 0, axis]) for axis in (0, 1)])
    lengths_m = np.linalg.norm(np.diff(places, axis=1), axis=0)
    durations_s = np.diff(np.interp(crossings, np.arange(len(times_s)), times_s))
    is_step = lengths_m > _MIN_STEP * height_m
    if is_step.sum() < _MIN_STEPS:
        return None
    length_m, per_min = float(np.median(lengths_m[is_step])), 60.0 / float(np.median(durations_s[is_step]))
    return Steps(length_m, per_min, length_m / per_min / (_USUAL * (height_m / _HEIGHT_M) ** 1.5))


def _crossings(values: FloatArray, threshold: float) -> FloatArray:
    """Return the times (n,), in frames, of the sign changes of values (F,) between exceedances of a threshold."""
    large = np.flatnonzero(np.abs(values) > threshold)
    changes = np.flatnonzero(np.diff(np.sign(values[large])))
    times = []
    for a, b in zip(large[changes], large[changes + 1], strict=True):
        k = a + int(np.flatnonzero(np.diff(np.sign(values[a : b + 1])))[0])
        times.append(k + values[k] / (values[k] - values[k + 1]))
    return np.array(times, np.float64)
