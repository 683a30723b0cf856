"""How far what a scene shows departs from what a tracker is told of it."""

from collections.abc import Mapping
from types import MappingProxyType

import numpy as np

from workbench.core.checks import Range

USUAL: Mapping[str, float] = MappingProxyType(
    {
        "lengths": 0.03, "radii": 0.1, "profile": 1.0, "clothes_m": 0.005,
        "camera": 0.002, "camera_deg": 0.1, "start_m": 0.03, "start_rad": 0.05,
    }
)  # fmt: skip
"""Sizes of all departures by their names, see `take.Scene`."""
NONE: Mapping[str, float] = MappingProxyType(dict.fromkeys(USUAL, 0.0))
SHOWN = ("lengths", "radii", "profile", "clothes_m")
"""Those that can be seen; the others are only in what is told."""
_PARTS = ("lengths", "radii", "camera")  # which are parts of a length
GIVEN = Range(
    f"sizes from 0 on, {', '.join(_PARTS)} below 0.5, by names of {', '.join(USUAL)}",
    lambda sizes: all(
        name in USUAL and 0.0 <= size < (0.5 if name in _PARTS else np.inf) for name, size in (sizes or {}).items()
    ),
)
"""What a dataset's key `departures` may hold."""


def sizes(exact: bool, departures: Mapping[str, float] | None) -> dict[str, float]:
    """The size of every departure: those given, and of the rest the usual, or none where the scene is exact."""
    return {**(NONE if exact else USUAL), **(departures or {})}
