"""Gait events: where in a motion a stride begins."""

import numpy as np
import scipy

from workbench.body.skeleton import POSE_NAMES
from workbench.motion.motion import Motion
from workbench.utils.arrays import FloatArray

GAIT_CUTOFF_HZ = 3.0
SHORTEST_S, LONGEST_S = 0.6, 2.0  # of a walking cycle
SHORTEST_RUN_S = 0.45  # of a running cycle; those of people in a hurry take 0.55 s
LEAST_SWING_RAD = 0.3


def gait_events(motion: Motion, shortest_s: float = SHORTEST_S) -> FloatArray:
    """Find where the left thigh is furthest ahead, in frames: peaks of the low-passed difference of the hip flexions.

    No two are nearer in time than about shortest_s. A parabola through each peak places it between the frames.
    """
    left, right = (POSE_NAMES.index(f"{side}_hip_flexion") for side in ("left", "right"))
    swing = motion.poses[:, left] - motion.poses[:, right]
    low_pass = scipy.signal.butter(2, GAIT_CUTOFF_HZ, fs=motion.rate_hz, output="sos")
    if len(swing) < shortest_s * motion.rate_hz:
        return np.empty(0)
    smooth = scipy.signal.sosfiltfilt(low_pass, swing, padtype="even")
    peaks, _ = scipy.signal.find_peaks(
        smooth, distance=max(1.0, shortest_s * motion.rate_hz), prominence=LEAST_SWING_RAD
    )
    before, at, after = smooth[peaks - 1], smooth[peaks], smooth[peaks + 1]
    return peaks + 0.5 * (before - after) / (before - 2.0 * at + after)
