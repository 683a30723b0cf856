"""Findings on frames that a video lacks although its times go on: steps in which all joints move several times as far.

A recorder that drops frames, or a file whose times are given as evenly spaced, shows a body that doubles its speed for
one frame. Bodies do not: within 1/15 s a walker would accelerate by 20 m/s².
"""

from collections.abc import Iterator

import numpy as np

from workbench.cameras.observed_joints import MIN_WEIGHT
from workbench.evaluation.verdict.run_measurements import RunMeasurements
from workbench.utils.arrays import FloatArray
from workbench.utils.finding import Finding
from workbench.utils.nan_statistics import nan_median

_MAX_STEP_S = 1.0 / 15.0
"""Time between frames up to which the joints' velocities in neighbouring steps are alike."""
_MIN_GAIN = 1.6
"""Factor of a step over the ones around it, between one frame and two."""
_MAX_GAIN_STD = 0.12
"""Largest standard deviation of the factor over the factor itself, or over 1 if it is less: an even motion is five of
them away from _MIN_GAIN, and a step of _MIN_GAIN three from an even motion."""
_MIN_STEPS = 15
_MAX_DROPPED = 0.05
"""Fraction of the steps that may be as long: speeds are then wrong by 5 %."""


def dropped_findings(measured: RunMeasurements) -> Iterator[Finding]:
    """Yield the finding that steps of all joints are too long for a single frame."""
    times_s = measured.times_s
    if len(times_s) < _MIN_STEPS or (np.diff(times_s) <= 0.0).any() or np.median(np.diff(times_s)) > _MAX_STEP_S:
        return
    gains = step_gains(measured.observed.pixels(MIN_WEIGHT), times_s)
    known = np.isfinite(gains)
    n_long = int((gains[known] > _MIN_GAIN).sum())
    if known.sum() >= _MIN_STEPS and n_long > _MAX_DROPPED * known.sum():
        missing = int(np.round(gains[known] - 1.0).clip(min=0.0).sum())
        text = (
            f"in {n_long} of {known.sum()} frames all joints move at once by {_MIN_GAIN:g} times or more of the others"
        )
        yield Finding("dropped frames", f"{text}: about {missing} frames are missing, and speeds are wrong")


def step_gains(pixels: FloatArray, times_s: FloatArray) -> FloatArray:
    """Return by which factors (F,) all joints move faster to a frame than in the two steps before and after it; NaN
    where the motion does not determine it, and at the ends.

    The factor is the projection of the velocities of all joints in all cameras on the medians of the neighbouring
    steps; its standard deviation follows from what remains. pixels: (V, F, J, 2), px, or NaN. times_s: (F,), s, F ≥ 6.
    """
    gains, n_steps = np.full(len(times_s), np.nan), len(times_s) - 1
    velocities = np.diff(pixels, axis=1) / np.diff(times_s)[:, None, None]
    steps = [velocities[:, shift : n_steps - 4 + shift] for shift in range(5)]
    now, around = steps[2], nan_median(np.stack([*steps[:2], *steps[3:]], axis=-1))
    known = np.isfinite(now) & np.isfinite(around)
    now, around = np.where(known, now, 0.0), np.where(known, around, 0.0)
    over = 0, 2, 3  # views, joints, coordinates
    n, square = known.sum(axis=over), np.square(around).sum(axis=over)
    gain = (now * around).sum(axis=over) / np.where(square > 0.0, square, np.nan)
    residual = np.square(now - gain[:, None, None] * around).sum(axis=over)
    std = np.sqrt(residual / np.maximum(n - 1, 1) / np.where(square > 0.0, square, np.nan))
    gains[3:-2] = np.where((n >= 2) & (std <= _MAX_GAIN_STD * np.maximum(gain, 1.0)), gain, np.nan)
    return gains
