"""Valid ranges of components' parameters, and the error for a value out of range."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from workbench.utils.errors import InputError
from workbench.utils.input_limits import RATES_HZ


@dataclass(frozen=True)
class Range:
    """Valid values of a parameter. description: for messages. contains: whether a value is valid; NaN never is."""

    description: str
    contains: Callable[[Any], bool]


POSITIVE = Range("positive", lambda value: 0.0 < value < np.inf)
RATE = Range(f"between {RATES_HZ[0]:g} and {RATES_HZ[1]:g} Hz", lambda value: RATES_HZ[0] <= value <= RATES_HZ[1])
INSIDE_UNIT = Range("between 0 and 1", lambda value: 0.0 < value < 1.0)
UNIT = Range("between 0 and 1", lambda value: 0.0 <= value <= 1.0)
UP_TO_1 = Range("above 0 and at most 1", lambda value: 0.0 < value <= 1.0)
BELOW_1 = Range("at least 0 and below 1", lambda value: 0.0 <= value < 1.0)
FINITE = Range("a finite number", np.isfinite)


def at_least(low: float) -> Range:
    """Return the range of finite numbers ≥ `low`."""
    return Range(f"at least {low:g}", lambda value: low <= value < np.inf)


def optional(valid: Range) -> Range:
    """Return the range with None."""
    return Range(f"{valid.description} or null", lambda value: value is None or valid.contains(value))


def one_of(*choices: str) -> Range:
    """Return the range of these words."""
    return Range(f"one of {', '.join(choices)}", lambda value: value in choices)


def check(location: str, component: object, **expected: Range) -> None:
    """Raise InputError for the first attribute of a component out of its range; `location` begins the message."""
    for name, valid in expected.items():
        value = getattr(component, name)
        if not valid.contains(value):
            raise InputError(f"{location}: {name} must be {valid.description}, found {value!r}")
