"""Whole turns: angles of poses that differ by them are the same pose, but not the same numbers."""

import numpy as np

from workbench.arrays import FloatArray

N_POSITION = 3
"""Numbers of a pose that are lengths, which come first; all others are angles."""


def nearest_turn(poses: FloatArray, reference: FloatArray) -> FloatArray:
    """Move every angle of poses (P,) or (N, P) by whole turns to within half a turn of that of `reference` (P,)."""
    rows, middle = np.atleast_2d(poses)[:, N_POSITION:], reference[N_POSITION:]
    if (rows.max(axis=0) - middle <= np.pi).all() and (middle - rows.min(axis=0) <= np.pi).all():
        return poses  # as nearly always, and told faster
    turns = np.rint((poses[..., N_POSITION:] - middle) / (2.0 * np.pi))
    moved = poses.copy()
    moved[..., N_POSITION:] -= 2.0 * np.pi * turns
    return moved


def wrapped(angles: FloatArray) -> FloatArray:
    """Take whole turns off angles, rad, of any shape: they come to lie in [−π, π)."""
    return (angles + np.pi) % (2.0 * np.pi) - np.pi
