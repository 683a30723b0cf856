"""Agreement of two runs' numbers, and the agreement that a check demands."""

from collections.abc import Mapping
from dataclasses import dataclass
from enum import IntEnum

import numpy as np

from workbench.utils.arrays import AnyArray

_RELATIVE, _ABSOLUTE = 1e-9, 1e-12
"""Largest effect of rounding: relative to a quantity's largest value, and in its unit near zero."""


class Agreement(IntEnum):
    """Classes of agreement, the closest first."""

    IDENTICAL = 0
    ROUNDING = 1
    TOLERANCE = 2
    CHANGED = 3

    def __str__(self) -> str:
        return ("identical", "equal to rounding", "within tolerance", "changed")[self]


@dataclass(frozen=True)
class Tolerance:
    """Largest change of a number: `absolute`, in its unit, or `relative` times its old value."""

    absolute: float = 0.0
    relative: float = 0.0

    def __str__(self) -> str:
        parts = [f"{self.absolute:g}"] if self.absolute > 0.0 else []
        parts += [f"{100.0 * self.relative:g} %"] if self.relative > 0.0 else []
        return "± " + (" or ".join(parts) or "0")


@dataclass(frozen=True)
class Demand:
    """The agreement that a comparison demands of every number.

    tolerances: with the agreement TOLERANCE, by metric or "figure NAME", "study_metrics" for all other figures of
    studies, and "default" for all other numbers.
    """

    agreement: Agreement
    tolerances: Mapping[str, Tolerance]

    def of(self, name: str) -> Tolerance | None:
        """Return the tolerance of a metric; None where the demand is stricter."""
        if self.agreement < Agreement.TOLERANCE:
            return None
        names = (name, *["study_metrics"] * name.startswith("figure "), "default")
        return next((self.tolerances[each] for each in names if each in self.tolerances), Tolerance())

    def words(self, name: str) -> str:
        """Return the demand on a metric in words."""
        return str(self.of(name) or ("identical" if self.agreement is Agreement.IDENTICAL else "rounding"))


@dataclass(frozen=True)
class MetricChange:
    """The change of one quantity of a run.

    quantity: a metric's name, or frame numbers, poses, marginals, figure <name>, run. was, now: its value, or None.
    allowed: the demand in words. passed: the demand is met. detail: the first difference. agreement: its class; None
    where single numbers were not compared.
    """

    quantity: str
    was: float | None
    now: float | None
    allowed: str
    passed: bool
    detail: str = ""
    agreement: Agreement | None = None


def agreement(was: object, now: object, tolerance: Tolerance | None = None) -> Agreement:
    """Return the agreement of two values.

    Parameters
    ----------
    was, now : numbers, texts, or arrays of them of any shape. NaN agrees with NaN.
    tolerance : None: only rounding.

    Returns
    -------
    Agreement : of the number that agrees least. Rounding is _RELATIVE times the largest finite magnitude in the array,
        plus _ABSOLUTE; of float32 at least one unit in the last place of each number.
    """
    first, second = np.asarray(was), np.asarray(now)
    if first.shape != second.shape or first.dtype.kind != second.dtype.kind:
        return Agreement.CHANGED
    if first.dtype.kind != "f":
        return Agreement.IDENTICAL if np.array_equal(first, second) else Agreement.CHANGED
    if not np.array_equal(np.isnan(first), np.isnan(second)):
        return Agreement.CHANGED
    valid = ~np.isnan(first)
    old, new = first[valid], second[valid]
    if np.array_equal(old, new):
        return Agreement.IDENTICAL
    with np.errstate(invalid="ignore"):  # infinities agree where they are equal
        change = np.where(old == new, 0.0, np.abs(new - old))
    if (change <= _rounding(old)).all():
        return Agreement.ROUNDING
    if tolerance is None or not np.isfinite([old, new]).all():
        return Agreement.CHANGED
    allowed = np.maximum(tolerance.absolute, tolerance.relative * np.abs(old))
    return Agreement.TOLERANCE if (change <= allowed).all() else Agreement.CHANGED


def _rounding(values: AnyArray) -> AnyArray:
    finite = np.abs(values[np.isfinite(values)])
    bound = np.full(values.shape, _RELATIVE * float(finite.max(initial=0.0)) + _ABSOLUTE)
    return np.maximum(bound, np.spacing(np.abs(values))) if values.dtype == np.float32 else bound
