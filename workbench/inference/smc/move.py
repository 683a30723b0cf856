"""What makes a frame's particles of those of the frame before, in which filters differ, and wrappers of a filter."""

from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass, field, replace
from typing import Any, ClassVar, Literal, Protocol, Self, TypeAlias

import numpy as np

from workbench.core.capabilities import DENSITY, Traits, offering
from workbench.core.filter_state import Past
from workbench.core.frame import Frame
from workbench.core.prior import Prior
from workbench.core.state_space import StateSpace
from workbench.core.step import Inference, Step
from workbench.inference.smc.target import MoveResult, Target, density_of
from workbench.utils.arrays import FloatArray
from workbench.utils.errors import InputError

Streams: TypeAlias = Mapping[str, np.random.Generator]
"""The run's generators, by name; moves draw from "resampling" and "prior"."""
First: TypeAlias = tuple[Mapping[str, float], tuple[str, ...]]
"""Diagnostics and warnings of a run's first step; a recording arranges its views by what that one has."""


class Move(Protocol):
    """One frame's step of a particle filter: choose parents, draw, weigh."""

    @property
    def proposes(self) -> bool:
        """Return whether it draws from the prior's own proposal, where there is one."""

    @property
    def gathers(self) -> bool:
        """Return whether of the parents' states it looks at those alone that have offspring."""

    def check(self, prior: Prior, n_particles: int) -> None:
        """Raise InputError for a prior without what it needs, and too few particles."""

    def first(self, n_particles: int) -> First:
        """Return what to say of a run's first step, for which nothing moves."""

    def __call__(self, target: Target, rng_streams: Streams) -> MoveResult:
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
        return {**self.first_diagnostics, "unique_particles": float(n_particles)}, self.first_warnings


@dataclass(frozen=True, eq=False)
class WrappedMove:
    """A move that a wrapper does something around: `around(move, target, rng_streams)` makes the particles.
    diagnostics: of the first step, beside the move's own."""

    move: Move
    around: Callable[[Move, Target, Streams], MoveResult]
    diagnostics: Mapping[str, float] = field(default_factory=dict)

    gathers: ClassVar[bool] = False  # as `around` may look at any

    @property
    def proposes(self) -> bool:
        """Return as the move does."""
        return self.move.proposes

    def check(self, prior: Prior, n_particles: int) -> None:
        """Raise InputError where the move does."""
        self.move.check(prior, n_particles)

    def first(self, n_particles: int) -> First:
        """Join the first step's diagnostics to the move's."""
        diagnostics, warnings = self.move.first(n_particles)
        return {**diagnostics, **self.diagnostics}, warnings

    def __call__(self, target: Target, rng_streams: Streams) -> MoveResult:
        """Make the particles by what is around the move."""
        return self.around(self.move, target, rng_streams)


Kind: TypeAlias = Literal["filtered", "restarted", "smoothed"]
"""What steps are: those of a filter whose particles come from their ancestors by the prior; of one some of whose
particles start anew; or told by later frames too."""


class Filter(Inference, Protocol):
    """A particle filter, perhaps with wrappers around it."""

    @property
    def prior(self) -> Prior: ...
    @property
    def move(self) -> Move: ...
    @property
    def n_particles(self) -> int | None: ...
    @property
    def kind(self) -> Kind: ...
    @property
    def resumable(self) -> bool: ...

    def rebuilt(self, **parts: Any) -> Self:
        """Replace parts of the particle filter, such as the prior, the move or n_particles."""

    def run(self, frames: Iterable[Frame], start: FloatArray | Past | None, rng_streams: Streams) -> Iterator[Step]:
        """Yield one step per frame, or for those after a past, see `Resumable`."""


@dataclass(frozen=True, eq=False)
class Wrapper:
    """A filter, and what all that stand around one have in common. n_particles: in place of the filter's. wraps: kinds
    of steps that it can make something of; kind: of its own. Raises InputError for other steps."""

    @staticmethod
    def traits(keys: Mapping[str, Any]) -> Traits:
        """Declare what the filter needs."""
        return keys["filter"]

    filter: Filter
    n_particles: int | None = field(default=None, kw_only=True)

    wraps: ClassVar[tuple[Kind, ...]] = ("filtered",)
    kind: ClassVar[Kind] = "filtered"

    def __post_init__(self) -> None:
        if self.filter.kind not in self.wraps:
            raise InputError(
                f"inference: {type(self).__name__} expected a filter whose steps are {' or '.join(self.wraps)}, found "
                f"{type(self.filter).__name__}, whose steps are {self.filter.kind}; try them the other way round"
            )
        if self.n_particles is None:
            object.__setattr__(self, "n_particles", self.filter.n_particles)
        else:
            object.__setattr__(self, "filter", self.filter.rebuilt(n_particles=self.n_particles))

    @property
    def prior(self) -> Prior:
        """Return the filter's."""
        return self.filter.prior

    @property
    def move(self) -> Move:
        """Return the filter's."""
        return self.filter.move

    @property
    def space(self) -> StateSpace:
        """Return the filter's."""
        return self.filter.space

    @property
    def finds_start(self) -> bool:
        """Return whether the filter finds the first pose itself."""
        return self.filter.finds_start

    @property
    def resumable(self) -> bool:
        """Return whether the filter can go on from a past; what has to see all frames first cannot."""
        return self.filter.resumable

    def rebuilt(self, **parts: Any) -> Self:
        """Replace parts of the particle filter, such as the prior, the move or n_particles."""
        return replace(self, filter=self.filter.rebuilt(**parts), n_particles=None)
