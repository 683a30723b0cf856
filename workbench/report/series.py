"""Groups that differ only in their number of particles, which the plots show as one series in one colour."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from workbench.recording.study.drawing import SERIES
from workbench.report.groups import Group, Grouping
from workbench.report.statistics import statistic
from workbench.report.variation import label

PARTICLES = "inference.n_particles"
_LIGHTEST = 0.55

Colour = tuple[float, float, float]


@dataclass(frozen=True, eq=False)
class Series:
    """label: what its groups have in common. groups: by rising number of particles. colour: RGB, 0 to 1."""

    label: str
    groups: tuple[Group, ...]
    colour: Colour

    def shade(self, group: Group) -> Colour:
        """The group's own colour: the series' for most particles, lighter for fewer."""
        behind = len(self.groups) - 1 - self.groups.index(group)
        white = _LIGHTEST * behind / max(len(self.groups) - 1, 1)
        return mixed(self.colour, 1.0, white)


def all_series(grouping: Grouping, metric: str) -> tuple[list[Series], int]:
    """The series with the least `metric`, as many as there are colours, in the groups' order; and how many more exist.

    Groups without the metric are in none.
    """
    keys = [key for key in grouping.variation.keys if key != PARTICLES]
    members: dict[str, list[Group]] = {}
    for group in grouping.groups:
        if statistic(group, metric) is not None:
            name = label(keys, group.values) or str(group.settings["experiment"])
            members.setdefault(name, []).append(group)
    best = sorted(members, key=lambda name: _least(members[name], metric))[: len(SERIES)]
    shown = [name for name in members if name in best]
    series = [
        Series(name, tuple(sorted(members[name], key=n_particles)), rgb(colour))
        for name, colour in zip(shown, SERIES, strict=False)
    ]
    return series, len(members) - len(series)


def n_particles(group: Group) -> float:
    """The group's number of particles, 0 where it has none."""
    found = group.settings.get(PARTICLES)
    return float(found) if isinstance(found, int | float) else 0.0


def _least(groups: Sequence[Group], metric: str) -> float:
    return min((found.mean for group in groups if (found := statistic(group, metric))), default=np.inf)


def rgb(colour: str) -> Colour:
    """#RRGGBB as numbers from 0 to 1."""
    red, green, blue = (int(colour[i : i + 2], 16) / 255.0 for i in (1, 3, 5))
    return red, green, blue


def mixed(colour: Colour, other: float, part: float) -> Colour:
    """A colour with a part of white (other = 1) or black (0)."""
    red, green, blue = (value + part * (other - value) for value in colour)
    return red, green, blue
