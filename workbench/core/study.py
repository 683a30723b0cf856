"""The interface of studies, and their results: metrics and figures as plain data."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Protocol, TypeAlias

import numpy as np

from workbench.utils.arrays import FloatArray, IntArray


@dataclass(frozen=True, eq=False)
class Curves:
    """Curves over one axis in one plot. curves: {label: (n,)}, NaN where a curve is interrupted. x: (n,), ascending.
    x_name, y_name: with their units. marks: {label: x}, vertical lines. faint: {label: (n,)}, further curves,
    thin behind the others and omitted from the legend."""

    name: str
    x: FloatArray
    curves: Mapping[str, FloatArray]
    x_name: str
    y_name: str
    marks: Mapping[str, float] = field(default_factory=dict)
    faint: Mapping[str, FloatArray] = field(default_factory=dict)


@dataclass(frozen=True, eq=False)
class Bars:
    """A histogram or bar chart. x: (n,), centres of the bars. heights: (n,). model: (n,), heights predicted by a model,
    drawn over the bars, or None."""

    name: str
    x: FloatArray
    heights: FloatArray
    x_name: str
    model: FloatArray | None = None


@dataclass(frozen=True, eq=False)
class Scatter:
    """Points in the plane. points: {label: (n, 2)}, x and y of each. x_name, y_name: with their units."""

    name: str
    points: Mapping[str, FloatArray]
    x_name: str
    y_name: str


@dataclass(frozen=True, eq=False)
class Sticks:
    """Stick figures in 3-D. positions: (n, J, 3), m. parents: (J,), -1 for the root. shades: (n,), from 0, dark, to 1,
    light."""

    name: str
    positions: FloatArray
    parents: IntArray
    shades: FloatArray


Figure: TypeAlias = Curves | Bars | Scatter | Sticks


@dataclass(frozen=True, eq=False)
class StudyResult:
    """The result of a study. metrics: numbers for summary.json. figures: in display order, with unique names; those
    named "page/name" are on one page. note: a paragraph of Markdown that describes the figures and names the paper's
    figure."""

    metrics: Mapping[str, float]
    figures: tuple[Figure, ...]
    note: str


class Study(Protocol):
    """An experiment without frames."""

    def run(self, rng: np.random.Generator) -> StudyResult:
        """Return the result of the study; `rng` is the only source of randomness."""
