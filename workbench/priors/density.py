"""What the densities of priors are made of."""

import numpy as np

from workbench.arrays import FloatArray
from workbench.core.state_space import StateSpace

REFERENCE_RATE_HZ = 30.0
"""The frames a second for which priors are given their noise."""

SAME = 1e-9
"""Columns without noise are where they were to this, in their unit."""


def circular(space: StateSpace) -> list[int]:
    """The columns that are phases, counted in cycles: 0 and 1 are the same."""
    return [i for i, unit in enumerate(space.units) if unit == "cycle"]


def apart(space: StateSpace, first: FloatArray, second: FloatArray) -> FloatArray:
    """second − first, (..., D), of states (..., D) that broadcast; phases by the shortest way round, ±1/2 cycle."""
    difference: FloatArray = second - first
    phases = circular(space)
    difference[..., phases] -= np.round(difference[..., phases])
    return difference


def log_normal(deviation: FloatArray, sigma: FloatArray) -> FloatArray:
    """log N(deviation; 0, diag σ²), (...), of deviations (..., D) for σ (D,).

    Columns with σ = 0 have no density: they add nothing where the deviation is zero, and make it −∞ where not.
    """
    free = sigma > 0.0
    white = deviation[..., free] / sigma[free]
    density: FloatArray = -0.5 * (white**2).sum(axis=-1) - float(np.log(np.sqrt(2.0 * np.pi) * sigma[free]).sum())
    if not free.all():
        density = np.where((np.abs(deviation[..., ~free]) <= SAME).all(axis=-1), density, -np.inf)
    return density
