"""Findings on the support of the body: accelerations that its weight on the feet cannot cause.

The ground's force passes the feet at the zero-moment point, which lies under the centre of mass c but for its
acceleration: c − a h / (g + a_z) at the height h above the ground (Vukobratović & Borovac, *Int. J. Humanoid Robotics*
1, 2004). It cannot leave the feet. Accelerations grow with the square of the rate of the frames, so that gravity shows
a rate that is too high, of any motion on the feet.
"""

from collections.abc import Iterator

import numpy as np
import scipy

from workbench.body.centre_of_mass import centre_of_mass
from workbench.body.shape import ANKLE_HEIGHT
from workbench.body.skeleton import JOINT_NAMES
from workbench.body.stature import SIDES, usual_height
from workbench.evaluation.verdict.run_measurements import RunMeasurements
from workbench.utils.arrays import FloatArray
from workbench.utils.finding import Finding

_GRAVITY = 9.81
_REACH = 0.11
"""Distance of the tips of the toes from the ankle over the person's height: a foot is 0.152 long, and the ankle is a
quarter of it in front of the heel. In 538 recorded motions, of walks, runs, kicks and dances, the median distance of
the zero-moment point from the ankles is up to 0.08."""
_WINDOW_S, _MIN_WINDOW, _CUBIC = 0.25, 5, 3
"""Time over which the centre of mass is a cubic polynomial: half a step, in which it swings once."""
_MIN_SUPPORT = 0.5
"""Vertical force over the weight from which on the feet carry the body."""
_MIN_FRAMES = 20
_UNEVEN = 0.1
"""Largest relative deviation of the steps between frames, over a window, from even ones."""


def support_findings(measured: RunMeasurements) -> Iterator[Finding]:
    """Yield the finding that the body's accelerations need a support beyond the feet, in the median of the frames in
    which the centre of mass is over the feet. None with true positions, and for images alone."""
    if measured.has_truth or not measured.has_keypoints:
        return
    height_m = usual_height(measured.lengths_m)
    pressure_m, mass_m = support_distances(measured.estimated_joints, measured.times_s, height_m)
    reach_m = _REACH * height_m
    over_feet = np.isfinite(pressure_m) & (mass_m <= reach_m) & measured.observed_frames
    if over_feet.sum() >= _MIN_FRAMES and (beyond_m := float(np.median(pressure_m[over_feet]))) > reach_m:
        text = f"the accelerations of the body would need a support {100.0 * beyond_m:.0f} cm from the ankles"
        yield Finding("frame-rate mismatch", f"{text}: the rate of the frames is too high, or the motion wrong")


def support_distances(joints: FloatArray, times_s: FloatArray, height_m: float) -> tuple[FloatArray, FloatArray]:
    """Return the horizontal distances (F,) each, m, of the zero-moment point and of the centre of mass from the line
    between the ankles; NaN where the feet do not carry the body, and where the frames are too far apart.

    Parameters
    ----------
    joints : (F, J, 3), m, in the order of JOINT_NAMES, z up.
    times_s : (F,), s, increasing.
    height_m : the person's.
    """
    unknown = np.full(len(joints), np.nan)
    steps_s = np.diff(times_s)
    if len(joints) < _MIN_FRAMES or (steps_s <= 0.0).any():
        return unknown, unknown
    step_s = float(np.median(steps_s))
    window = 2 * round(0.5 * _WINDOW_S / step_s) + 1
    if window < _MIN_WINDOW or window > len(joints):
        return unknown, unknown
    ankles = joints[:, [JOINT_NAMES.index(f"{side}_ankle") for side in SIDES]]
    mass = np.einsum("j,fjk->fk", centre_of_mass(JOINT_NAMES), joints)
    acceleration = scipy.signal.savgol_filter(mass, window, _CUBIC, deriv=2, delta=step_s, axis=0)
    force = 1.0 + acceleration[:, 2] / _GRAVITY  # over the weight
    above_m = mass[:, 2] - ankles[..., 2].min(axis=1) + ANKLE_HEIGHT * height_m
    lever = above_m / (_GRAVITY * np.maximum(force, _MIN_SUPPORT))
    pressure = mass[:, :2] - acceleration[:, :2] * lever[:, None]
    uneven = np.abs(steps_s / step_s - 1.0) > _UNEVEN
    reach, around = window // 2, np.ones(window - 1)
    valid = (force >= _MIN_SUPPORT) & np.isfinite(pressure).all(axis=1)
    valid[:reach] = valid[len(valid) - reach :] = False
    valid[reach : len(valid) - reach] &= np.convolve(uneven, around, mode="valid") == 0.0
    from_ankles = [_from_segment(points, ankles[..., :2]) for points in (pressure, mass[:, :2])]
    return np.where(valid, from_ankles[0], np.nan), np.where(valid, from_ankles[1], np.nan)


def _from_segment(points: FloatArray, ends: FloatArray) -> FloatArray:
    """Return the distances (F,) of points (F, 2) from the segments between ends (F, 2, 2)."""
    along = ends[:, 1] - ends[:, 0]
    offset = points - ends[:, 0]
    share = (offset * along).sum(axis=1) / np.maximum(np.square(along).sum(axis=1), 1e-12)
    return np.asarray(np.linalg.norm(offset - np.clip(share, 0.0, 1.0)[:, None] * along, axis=1))
