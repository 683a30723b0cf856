"""Which values a part's parameters may have, and the sentence for one that is out of range."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from workbench.utils.errors import InputError
from workbench.utils.input_limits import RATES_HZ


@dataclass(frozen=True)
class Range:
    """Values of a parameter. words: what they must be. holds: whether a value is one of them; NaN never is."""

    words: str
    holds: Callable[[Any], bool]


POSITIVE = Range("positive", lambda value: 0.0 < value < np.inf)
RATE = Range(f"between {RATES_HZ[0]:g} and {RATES_HZ[1]:g} Hz", lambda value: RATES_HZ[0] <= value <= RATES_HZ[1])
INSIDE_UNIT = Range("between 0 and 1", lambda value: 0.0 < value < 1.0)
UNIT = Range("between 0 and 1", lambda value: 0.0 <= value <= 1.0)
UP_TO_1 = Range("above 0 and at most 1", lambda value: 0.0 < value <= 1.0)
BELOW_1 = Range("at least 0 and below 1", lambda value: 0.0 <= value < 1.0)
FINITE = Range("a finite number", np.isfinite)


def at_least(low: float) -> Range:
    """Finite numbers from `low` on."""
    return Range(f"at least {low:g}", lambda value: low <= value < np.inf)


def one_of(*choices: str) -> Range:
    """These words alone."""
    return Range(f"one of {', '.join(choices)}", lambda value: value in choices)


def check(place: str, part: object, **expected: Range) -> None:
    """Raise InputError, which names the place, for the first attribute of a part that is not in the range expected."""
    for name, values in expected.items():
        value = getattr(part, name)
        if not values.holds(value):
            raise InputError(f"{place}: {name} must be {values.words}, found {value!r}")
