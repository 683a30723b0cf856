"""Names, units and groups of the columns of a state."""

from collections.abc import Mapping
from dataclasses import dataclass


@dataclass(frozen=True)
class StateSpace:
    """Column layout of a packed particle array (N, D).

    names, units : one per column. slices : named groups of columns, e.g. "coefficients", "phase", "root".
    """

    names: tuple[str, ...]
    units: tuple[str, ...]
    slices: Mapping[str, slice]

    def __len__(self) -> int:
        return len(self.names)

    @staticmethod
    def of(groups: Mapping[str, tuple[tuple[str, ...], str]]) -> "StateSpace":
        """Return a state space from {group: (column names, unit)}, in this order."""
        space = StateSpace((), (), {})
        for group, (columns, unit) in groups.items():
            space = space.appended(group, columns, (unit,) * len(columns))
        return space

    def appended(self, group: str, columns: tuple[str, ...], units: tuple[str, ...]) -> "StateSpace":
        """Return the state space with another group of columns at the end, one unit per column."""
        names = (*self.names, *columns)
        return StateSpace(names, (*self.units, *units), {**self.slices, group: slice(len(self), len(names))})
