"""The condition that ends a run early, such as `n_track_losses>0`."""

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
class StopWhen:
    """A number of the run so far, one of `Summary.metrics`, compared with a bound."""

    name: str
    sign: str
    bound: float

    def __call__(self, metrics: Mapping[str, float]) -> bool:
        """Return whether it holds; what is not there yet, or not a number, holds nothing."""
        return self.name in metrics and _ORDERS[self.sign](metrics[self.name], self.bound)

    def __str__(self) -> str:
        return f"{self.name}{self.sign}{self.bound:g}"


def stop_when(text: str) -> StopWhen:
    """Read `name<number`; raises InputError for anything else."""
    if match := _CONDITION.fullmatch(text):
        name, sign, bound = match.groups()
        with suppress(ValueError):
            if math.isfinite(number := float(bound)):
                return StopWhen(name, sign, number)
    raise InputError(
        f"sweep.stop_when: expected a number of the run and a bound, such as n_track_losses>0, found {text!r}"
    )
