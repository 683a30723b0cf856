"""Conditions that end a run early, such as `n_track_losses>0`."""

import math
import operator
import re
from collections.abc import Callable, Mapping
from contextlib import suppress
from dataclasses import dataclass

from workbench.utils.errors import InputError

_ORDERS: Mapping[str, Callable[[float, float], bool]] = {
    "<": operator.lt, "<=": operator.le, ">": operator.gt, ">=": operator.ge, "=": operator.eq,
}  # fmt: skip
_CONDITION = re.compile(r"\s*([\w./-]+?)\s*(<=|>=|<|>|=)\s*(\S+)\s*")


@dataclass(frozen=True)
class StopCondition:
    """Comparison of a metric of the run so far (`Summary.metrics`) with a bound."""

    name: str
    sign: str
    bound: float

    def __call__(self, metrics: Mapping[str, float]) -> bool:
        """Return whether the condition holds; False for a missing metric or NaN."""
        return self.name in metrics and _ORDERS[self.sign](metrics[self.name], self.bound)

    def __str__(self) -> str:
        return f"{self.name}{self.sign}{self.bound:g}"


def parse_stop_condition(text: str) -> StopCondition:
    """Return the condition of a text `name<number`; InputError for any other text."""
    if match := _CONDITION.fullmatch(text):
        name, sign, bound = match.groups()
        with suppress(ValueError):
            if math.isfinite(number := float(bound)):
                return StopCondition(name, sign, number)
    raise InputError(f"sweep.stop_if: expected a metric and a bound, such as n_track_losses>0, found {text!r}")
