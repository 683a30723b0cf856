"""Distances between the rays of two cameras, if the clock of one of them is shifted."""

from collections.abc import Callable

import numpy as np

from workbench.cameras.triangulation import ray_distances
from workbench.utils.arrays import FloatArray


def distance_curve(
    rays_a: FloatArray, a_s: FloatArray, rays_b: FloatArray, b_s: FloatArray, baseline: FloatArray,
    shifts_s: FloatArray, average: Callable[[FloatArray], float],
) -> FloatArray:  # fmt: skip
    """Return the average distances (S,), m, between the rays of two cameras, the second of which is later by shifts.

    A frame of the first camera is compared with the nearest frame of the second, up to half an interval away.

    Parameters
    ----------
    rays_a, rays_b : (T, ..., 3) unit directions, which broadcast except for T; NaN for a missing ray.
    a_s, b_s : (T,) times, increasing, s.
    baseline : (3,) from the first camera to the second, m.
    shifts_s : (S,) added to b_s.
    average : of the distances (T', ...), m, in the frames compared, see `ray_distances`.
    """
    max_distance_s = 0.51 * np.median(np.diff(b_s))
    curve = np.empty(len(shifts_s))
    for s, shift_s in enumerate(shifts_s):
        after = np.clip(np.searchsorted(b_s + shift_s, a_s), 1, len(b_s) - 1)
        row = np.where(a_s - b_s[after - 1] - shift_s < b_s[after] + shift_s - a_s, after - 1, after)
        near = np.abs(b_s[row] + shift_s - a_s) <= max_distance_s
        curve[s] = average(ray_distances(rays_a[near], rays_b[row[near]], baseline))
    return curve
