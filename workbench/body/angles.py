"""Whole turns: angles of poses that differ by them are the same pose, but not the same numbers."""

from typing import Any

import numpy as np

from workbench.utils.arrays import FloatArray
from workbench.utils.kernel_cache import kernel

N_POSITION = 3
"""Numbers of a pose that are lengths, which come first; all others are angles."""


def nearest_turn(poses: FloatArray, reference: FloatArray) -> FloatArray:
    """Move every angle of poses (P,) or (N, P) by whole turns to within half a turn of that of `reference` (P,)."""
    middle = reference[N_POSITION:]
    if not _far(np.atleast_2d(poses), reference).any():
        return poses  # as nearly always, and told faster
    turns = np.rint((poses[..., N_POSITION:] - middle) / (2.0 * np.pi))
    moved = poses.copy()
    moved[..., N_POSITION:] -= 2.0 * np.pi * turns
    return moved


@kernel()
def _far(poses: Any, reference: Any) -> Any:
    """Count the poses (N, P) of which a number (P,) is an angle that is not within half a turn of the reference's.
    NumPy's maximum over so many short rows takes ten times as long."""
    far = np.zeros(reference.shape[0])
    for i in range(poses.shape[0]):
        for p in range(N_POSITION, reference.shape[0]):
            far[p] += 0.0 if abs(poses[i, p] - reference[p]) <= np.pi else 1.0
    return far


def wrapped(angles: FloatArray) -> FloatArray:
    """Take whole turns off angles, rad, of any shape: they come to lie in [−π, π)."""
    return (angles + np.pi) % (2.0 * np.pi) - np.pi
