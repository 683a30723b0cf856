"""What the densities and the penalties of priors are made of."""

from collections.abc import Mapping, Sequence
from dataclasses import fields

import numpy as np

from workbench.core.prior import Smoothness
from workbench.core.state_space import StateSpace
from workbench.utils.arrays import FloatArray, IntArray
from workbench.utils.errors import InputError

REFERENCE_RATE_HZ = 30.0  # the frames a second for which priors are given their noise
SAME = 1e-9  # columns without noise are where they were to this, in their unit


class AllFree:
    """The part of a `Density` that says that no column of the prior's space follows from others."""

    space: StateSpace

    @property
    def free(self) -> IntArray:
        """All columns (D,)."""
        return np.arange(len(self.space))

    def complete(self, previous: FloatArray, state: FloatArray, dt_s: float, rng: np.random.Generator) -> FloatArray:
        """Return the states (N, D) as they are."""
        return state


def by_column(space: StateSpace, **groups: float | Sequence[float] | FloatArray) -> FloatArray:
    """Lay out values by column (D,): one or several for every group that is named, zero elsewhere."""
    columns = np.zeros(len(space))
    for group, values in groups.items():
        columns[space.slices[group]] = values
    return columns


def circular(space: StateSpace) -> list[int]:
    """Find the columns that are phases, counted in cycles: 0 and 1 are the same."""
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


def smoothness(penalty: Mapping[str, float] | None) -> Smoothness:
    """Return `Smoothness` with the fields that are given, positive numbers; the others keep their defaults.

    Raises InputError for an unknown field and for a number that is none or not positive.
    """
    given, known = dict(penalty or {}), [field.name for field in fields(Smoothness)]
    for name, value in given.items():
        if name not in known:
            raise InputError(f"prior: penalty: expected some of {', '.join(known)}, found {name!r}")
        if not 0.0 < value < np.inf:
            raise InputError(f"prior: penalty.{name} must be a positive number, found {value}")
    return Smoothness(**given)
