"""Which values a likelihood's constants may have, and the sentence for one that is out of range."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from workbench.errors import InputError


@dataclass(frozen=True)
class Range:
    """Values of a constant. said: what they must be, in words. holds: whether a value is one of them; NaN never is."""

    said: str
    holds: Callable[[float], bool]


POSITIVE = Range("positive", lambda value: 0.0 < value < np.inf)
NOT_NEGATIVE = Range("at least 0", lambda value: 0.0 <= value < np.inf)
INSIDE_UNIT = Range("between 0 and 1", lambda value: 0.0 < value < 1.0)
"""Shares of outliers, which must leave something to both sides."""
TEMPER = Range("above 0 and at most 1", lambda value: 0.0 < value <= 1.0)


def at_least(low: int) -> Range:
    """Numbers from `low` on."""
    return Range(f"at least {low}", lambda value: value >= low)


def check(place: str, expected: Range, **constants: float) -> None:
    """Raise InputError, which names the place, for the first of the constants that is not in the range expected."""
    for name, value in constants.items():
        if not expected.holds(value):
            raise InputError(f"{place}: {name} must be {expected.said}, found {value!r}")


def check_choice(place: str, choices: tuple[str, ...], **constants: str) -> None:
    """Raise InputError, which names the place, for the first of the constants that is none of the choices."""
    for name, value in constants.items():
        if value not in choices:
            raise InputError(f"{place}: {name} must be {', '.join(choices[:-1])} or {choices[-1]}, found {value!r}")
