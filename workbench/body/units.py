"""Units of length, and the unit in which a person, or a scene with a person, has a plausible size."""

from collections.abc import Iterable, Mapping

import numpy as np

UNITS = {"m": 1.0, "cm": 0.01, "mm": 0.001, "inch": 0.0254, "cmu": 0.0254 / 0.45}
"""Metres per unit. "cmu" is the unit of the CMU database, 1/0.45 inch, also in its conversions to BVH."""
UNIT_NAMES = {"cm": "centimetres", "mm": "millimetres"}
PERSON_M = (0.45, 2.4)
"""Plausible heights of a person: from newborns of 0.5 m to the tallest adults, with a margin for inaccurate joints."""
TYPICAL_M = 1.7
_SMALL_M = 0.85
"""Height below which a stated unit is doubted: an adult in inches, read in centimetres, is up to as tall."""


def is_person(height_m: float) -> bool:
    """Return whether a person's height is plausible."""
    return PERSON_M[0] <= height_m <= PERSON_M[1]


def fits_person(height: float, metres: float) -> bool:
    """Return whether a stated unit, of some metres, gives a person a plausible height, in that unit.

    A small child is plausible unless another unit gives a larger person.
    """
    height_m, unit = height * metres, unit_of_person(height)
    return is_person(height_m) and (height_m >= _SMALL_M or (unit is not None and UNITS[unit] <= metres))


def unit_of_person(height: float, units: Iterable[str] = UNITS) -> str | None:
    """Return the unit in which a person's height is plausible, of several the one nearest to TYPICAL_M; None for none.

    Parameters
    ----------
    height : in the unknown unit.
    units : candidates, of UNITS.
    """
    plausible = [unit for unit in units if is_person(height * UNITS[unit])]
    return min(plausible, key=lambda unit: abs(np.log(height * UNITS[unit] / TYPICAL_M)), default=None)


def unit_of_extent(extent: float, ranges: Mapping[str, tuple[float, float]]) -> str | None:
    """Return the first unit whose range, in that unit, contains the extent of a scene; None for none."""
    return next((unit for unit, (low, high) in ranges.items() if low <= extent <= high), None)
