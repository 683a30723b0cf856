"""The names of a state's columns."""

from collections.abc import Mapping
from dataclasses import dataclass


@dataclass(frozen=True)
class StateSpace:
    """Names the D columns of a packed (N, D) particle array. names, units: one per column. slices: named groups of
    columns, e.g. "coefficients", "phase", "root"."""

    names: tuple[str, ...]
    units: tuple[str, ...]
    slices: Mapping[str, slice]

    def __len__(self) -> int:
        return len(self.names)

    @staticmethod
    def of(groups: Mapping[str, tuple[tuple[str, ...], str]]) -> "StateSpace":
        """Return a state space from {group: (column names, unit)}, the groups side by side in the order given."""
        space = StateSpace((), (), {})
        for group, (columns, unit) in groups.items():
            space = space.appended(group, columns, (unit,) * len(columns))
        return space

    def appended(self, group: str, columns: tuple[str, ...], units: tuple[str, ...]) -> "StateSpace":
        """Append a group of columns, with a unit each."""
        names = (*self.names, *columns)
        return StateSpace(names, (*self.units, *units), {**self.slices, group: slice(len(self), len(names))})
