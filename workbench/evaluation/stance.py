"""When each foot stands, of somebody who walks or runs."""

import numpy as np

from workbench.utils.arrays import FloatArray, IntArray

SLOWEST_M_S = 0.3
"""Of a pelvis that goes somewhere; slow walking is twice as fast."""
_STRIDE_S = 0.5  # before and after a frame, in which a pelvis shows the way: together about a stride
_STEP_S = 0.07  # the same for an ankle, whose swing takes 0.4 s


def stance(pelvis: FloatArray, ankles: FloatArray, times_s: FloatArray) -> FloatArray:
    """Tell where ankles (F, 2, 3), left and right, m, belong to feet that stand: (F, 2) of 1 and 0.

    A foot stands while its ankle goes backwards as seen from the pelvis (F, 3), and swings while it goes forwards
    (Zeni, Richards, Higginson 2008, the coordinate-based treadmill and overground algorithm). NaN where the pelvis is
    slower than SLOWEST_M_S, or where there is less than half a second. Unlike there, speeds are differences over
    twice _STEP_S instead of extrema of a filtered curve, and a runner's foot stands from the moment it is drawn back.
    """
    found = np.full((len(times_s), 2), np.nan)
    if len(times_s) < 2 or times_s[-1] - times_s[0] < _STRIDE_S:
        return found
    speed = _velocity(pelvis[:, :2], times_s, _STRIDE_S)
    pace = np.linalg.norm(speed, axis=1)
    goes = pace >= SLOWEST_M_S
    ahead = _velocity((ankles - pelvis[:, None])[..., :2], times_s, _STEP_S)
    forwards = np.einsum("fsk,fk->fs", ahead, speed)
    found[goes] = forwards[goes] < 0.0
    return np.where(np.isfinite(forwards), found, np.nan)


def _velocity(places: FloatArray, times_s: FloatArray, reach_s: float) -> FloatArray:
    """Differences of places (F, ...) over reach_s before and after, at least a frame, per second."""
    n = len(times_s)
    first: IntArray = np.minimum(np.searchsorted(times_s, times_s - reach_s), np.maximum(np.arange(n) - 1, 0))
    last = np.maximum(
        np.searchsorted(times_s, times_s + reach_s, side="right") - 1, np.minimum(np.arange(n) + 1, n - 1)
    )
    spans = (times_s[last] - times_s[first]).reshape(-1, *[1] * (places.ndim - 1))
    return np.asarray((places[last] - places[first]) / spans)
