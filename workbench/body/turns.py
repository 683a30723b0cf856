"""Whole turns: angles of poses that differ by them are the same pose, but not the same numbers."""

import numpy as np

from workbench.arrays import FloatArray

N_POSITION = 3
"""Numbers of a pose that are lengths, which come first; all others are angles."""


def nearest_turn(poses: FloatArray, reference: FloatArray) -> FloatArray:
    """Move every angle of poses (..., P) by whole turns to within half a turn of that of `reference` (P,)."""
    turns = np.rint((poses[..., N_POSITION:] - reference[N_POSITION:]) / (2.0 * np.pi))
    if not turns.any():
        return poses
    moved = poses.copy()
    moved[..., N_POSITION:] -= 2.0 * np.pi * turns
    return moved
