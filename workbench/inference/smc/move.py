"""What makes one frame's particles of those of the frame before, the part in which particle filters differ."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import ClassVar, Protocol, TypeAlias

import numpy as np

from workbench.core.capabilities import DENSITY, Traits, offering
from workbench.core.prior import Prior
from workbench.inference.smc.target import Moved, Target, density_of
from workbench.utils.errors import InputError

Streams: TypeAlias = Mapping[str, np.random.Generator]
"""The run's generators, by name; moves draw from "resampling" and "prior"."""
First: TypeAlias = tuple[Mapping[str, float], tuple[str, ...]]
"""Diagnostics and warnings of a run's first step; a recording arranges its views by what that one has."""


class Move(Protocol):
    """One frame's step of a particle filter: choose parents, draw, weigh."""

    @property
    def proposes(self) -> bool:
        """Tell whether it draws from the prior's own proposal, where there is one."""

    @property
    def gathers(self) -> bool:
        """Tell whether of the parents' states it looks at those alone that have offspring."""

    def check(self, prior: Prior, n_particles: int) -> None:
        """Raise InputError for a prior without what it needs, and too few particles."""

    def first(self, n_particles: int) -> First:
        """Tell what to say of a run's first step, for which nothing moves."""

    def __call__(self, target: Target, rng_streams: Streams) -> Moved:
        """Make N weighted particles of the target's parents."""


class DensityMove:
    """What moves have in common that evaluate the prior's density; their steps say how many parents have offspring.
    least_particles: it needs. first_diagnostics, first_warnings: see `First`."""

    traits: ClassVar[Traits] = offering(prior=DENSITY)

    proposes: ClassVar[bool] = False
    gathers: ClassVar[bool] = False
    least_particles: ClassVar[int] = 1
    first_diagnostics: ClassVar[Mapping[str, float]] = {}
    first_warnings: ClassVar[tuple[str, ...]] = ()

    def check(self, prior: Prior, n_particles: int) -> None:
        """Raise InputError for a prior without a density, and too few particles."""
        density_of(prior)
        if n_particles < self.least_particles:
            raise InputError(f"inference: n_particles must be at least {self.least_particles}, found {n_particles}")

    def first(self, n_particles: int) -> First:
        """Count every particle of the first step."""
        return {**self.first_diagnostics, "distinct": float(n_particles)}, self.first_warnings


@dataclass(frozen=True, eq=False)
class Surrounded:
    """A move that a wrapper does something around: `around(move, target, rng_streams)` makes the particles.
    diagnostics: of the first step, beside the move's own."""

    move: Move
    around: Callable[[Move, Target, Streams], Moved]
    diagnostics: Mapping[str, float] = field(default_factory=dict)

    gathers: ClassVar[bool] = False  # as nobody knows what is done around it

    @property
    def proposes(self) -> bool:
        """Tell as the move does."""
        return self.move.proposes

    def check(self, prior: Prior, n_particles: int) -> None:
        """Raise InputError where the move does."""
        self.move.check(prior, n_particles)

    def first(self, n_particles: int) -> First:
        """Join the first step's diagnostics to the move's."""
        diagnostics, warnings = self.move.first(n_particles)
        return {**diagnostics, **self.diagnostics}, warnings

    def __call__(self, target: Target, rng_streams: Streams) -> Moved:
        """Make the particles by what is around the move."""
        return self.around(self.move, target, rng_streams)
