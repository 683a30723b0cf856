"""How a measured quantity grows: values at rising sizes, the exponent of the power law, as text and as JSON."""

import json
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path

import numpy as np

from workbench.utils.atomic_write import whole_file


@dataclass(frozen=True)
class Curve:
    """Values (K,) of one quantity, above 0, at K rising sizes, at least two.

    name: the quantity. size: what grows, with its unit. unit: of the values.
    """

    name: str
    size: str
    unit: str
    sizes: tuple[float, ...]
    values: tuple[float, ...]

    def __post_init__(self) -> None:
        rising = len(self.sizes) >= 2 and self.sizes[0] > 0.0 and bool(np.all(np.diff(self.sizes) > 0.0))
        if not rising or len(self.values) != len(self.sizes) or not all(0.0 < v < np.inf for v in self.values):
            raise ValueError(f"{self.name}: expected values above 0 at two rising sizes or more, found {self}")

    @property
    def exponent(self) -> float:
        """p of value ∝ size^p: the slope of the logarithms by least squares, over the upper half of the sizes.

        The lower half tells of what a call costs however little it has to do.
        """
        upper = slice(min(len(self.sizes) // 2, len(self.sizes) - 2), None)
        return float(np.polyfit(np.log(self.sizes[upper]), np.log(self.values[upper]), 1)[0])


def told(curve: Curve) -> str:
    """The curve in two lines of a table: sizes above values, the exponent at their end."""
    sizes, values = (" ".join(f"{number:>9.3g}" for number in row) for row in (curve.sizes, curve.values))
    return f"{curve.size:<44}{sizes}\n{f'{curve.name}, {curve.unit}':<44}{values}   exponent {curve.exponent:.2f}"


def write_curves(path: Path, curves: Sequence[Curve]) -> None:
    """A JSON list of {name, size, unit, sizes, values, exponent}; raises InputError when it cannot be written."""
    rows = [asdict(curve) | {"exponent": curve.exponent} for curve in curves]
    with whole_file(path) as part:
        part.write_text(json.dumps(rows, indent=1, ensure_ascii=False, allow_nan=False) + "\n", encoding="utf-8")
