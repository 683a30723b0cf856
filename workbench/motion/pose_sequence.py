"""A motion: one clip as poses of the 25-parameter person, with its provenance, and its gait events."""

from dataclasses import dataclass, replace

import numpy as np
import scipy

from workbench.body.shape import Shape
from workbench.body.skeleton import POSE_NAMES
from workbench.utils.arrays import FloatArray

GAIT_CUTOFF_HZ = 3.0
MIN_CYCLE_S, MAX_CYCLE_S = 0.6, 2.0  # of a walking cycle
MIN_RUN_CYCLE_S = 0.45  # of a running cycle; fast runners take 0.55 s
MIN_SWING_RAD = 0.3


@dataclass(frozen=True, eq=False)
class Motion:
    """One person's motion, retargeted to the pose of `workbench.body.skeleton` (world z up).

    poses : (F, 25), m and rad, angles continuous in time (no jumps by 2π). rate_hz : frames per second. shape : the
    person's measurements. joint_error_mm : (14,) mean retargeting error at every joint of ERROR_JOINTS (zeros for
    generated motion). source, sha256, licence : the source file, its SHA-256 and its licence.
    """

    name: str
    subject: str
    activity: str
    rate_hz: float
    poses: FloatArray
    shape: Shape
    joint_error_mm: FloatArray
    source: str
    sha256: str
    licence: str

    def __len__(self) -> int:
        return len(self.poses)

    @property
    def velocities(self) -> FloatArray:
        """Time derivative of the poses, (F, 25), per second, by central differences."""
        return np.gradient(self.poses, 1.0 / self.rate_hz, axis=0)

    def resampled(self, rate_hz: float) -> "Motion":
        """Return the motion at another rate by cubic splines through the poses; the first frame is unchanged."""
        if rate_hz == self.rate_hz or len(self) < 2:
            return self
        times = np.arange(len(self)) / self.rate_hz
        new_times = np.arange(int(np.floor(times[-1] * rate_hz + 1e-9)) + 1) / rate_hz
        return replace(self, rate_hz=rate_hz, poses=scipy.interpolate.CubicSpline(times, self.poses)(new_times))


def gait_events(motion: Motion, min_cycle_s: float = MIN_CYCLE_S) -> FloatArray:
    """Return the frames, not whole, at which the left thigh is furthest ahead: gait events.

    They are the peaks of the low-passed difference of the hip flexions, at least about min_cycle_s apart, with
    parabolic interpolation between frames.
    """
    left, right = (POSE_NAMES.index(f"{side}_hip_flexion") for side in ("left", "right"))
    swing = motion.poses[:, left] - motion.poses[:, right]
    low_pass = scipy.signal.butter(2, GAIT_CUTOFF_HZ, fs=motion.rate_hz, output="sos")
    if len(swing) < min_cycle_s * motion.rate_hz:
        return np.empty(0)
    smooth = scipy.signal.sosfiltfilt(low_pass, swing, padtype="even")
    peaks, _ = scipy.signal.find_peaks(
        smooth, distance=max(1.0, min_cycle_s * motion.rate_hz), prominence=MIN_SWING_RAD
    )
    before, at, after = smooth[peaks - 1], smooth[peaks], smooth[peaks + 1]
    return peaks + 0.5 * (before - after) / (before - 2.0 * at + after)
