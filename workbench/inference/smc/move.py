"""Moves, which propagate the particles of one frame to the next and distinguish filters, and wrappers of filters."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from typing import Any, ClassVar, Literal, Protocol, Self, TypeAlias

import numpy as np

from workbench.core.capabilities import DENSITY, Traits, component_traits
from workbench.core.prior import Prior
from workbench.core.state_space import StateSpace
from workbench.core.step import Inference
from workbench.inference.smc.target import MoveResult, Target, density_of
from workbench.utils.errors import InputError

Streams: TypeAlias = Mapping[str, np.random.Generator]
"""The run's generators by name; moves use "resampling" and "prior"."""
InitialDiagnostics: TypeAlias = tuple[Mapping[str, float], tuple[str, ...]]
"""Diagnostics and warnings of a run's first step; a recording arranges its views by the first step's diagnostics."""


class Move(Protocol):
    """One frame's step of a particle filter: choose parents, sample, weight."""

    @property
    def proposes(self) -> bool:
        """Return whether it samples from the prior's proposal, if there is one."""

    def check(self, prior: Prior, n_particles: int) -> None:
        """Raise InputError for an unsuitable prior and too few particles."""

    def initial_diagnostics(self, n_particles: int) -> InitialDiagnostics:
        """Return diagnostics and warnings of a run's first step, for which nothing moves."""

    def __call__(self, target: Target, rng_streams: Streams) -> MoveResult:
        """Return N weighted particles from the target's parents."""


class DensityMove:
    """Base of moves that evaluate the prior's density; their steps report the number of parents with offspring.

    min_particles: required. first_diagnostics, first_warnings: see `InitialDiagnostics`.
    """

    traits: ClassVar[Traits] = component_traits(prior=DENSITY)

    proposes: ClassVar[bool] = False
    min_particles: ClassVar[int] = 1
    first_diagnostics: ClassVar[Mapping[str, float]] = {}
    first_warnings: ClassVar[tuple[str, ...]] = ()

    def check(self, prior: Prior, n_particles: int) -> None:
        """Raise InputError for a prior without a density, and too few particles."""
        density_of(prior)
        if n_particles < self.min_particles:
            raise InputError(f"inference: n_particles must be at least {self.min_particles}, found {n_particles}")

    def initial_diagnostics(self, n_particles: int) -> InitialDiagnostics:
        """Count every particle of the first step as distinct."""
        return {**self.first_diagnostics, "unique_particles": float(n_particles)}, self.first_warnings


@dataclass(frozen=True, eq=False)
class WrappedMove:
    """A move inside a wrapper's function: `around(move, target, rng_streams)` returns the particles.

    diagnostics: of the first step, in addition to the move's own.
    """

    move: Move
    around: Callable[[Move, Target, Streams], MoveResult]
    diagnostics: Mapping[str, float] = field(default_factory=dict)

    @property
    def proposes(self) -> bool:
        """Return the move's value."""
        return self.move.proposes

    def check(self, prior: Prior, n_particles: int) -> None:
        """Raise InputError if the move does."""
        self.move.check(prior, n_particles)

    def initial_diagnostics(self, n_particles: int) -> InitialDiagnostics:
        """Return the first step's diagnostics together with the move's."""
        diagnostics, warnings = self.move.initial_diagnostics(n_particles)
        return {**diagnostics, **self.diagnostics}, warnings

    def __call__(self, target: Target, rng_streams: Streams) -> MoveResult:
        """Return the particles of `around`."""
        return self.around(self.move, target, rng_streams)


Kind: TypeAlias = Literal["filtered", "reinitialized", "smoothed"]
"""Kind of steps: of a filter whose particles come from their ancestors by the prior; of one that reinitializes some of
its particles; or of a smoother, which uses later frames too."""


class Filter(Inference, Protocol):
    """A particle filter, possibly with wrappers around it."""

    @property
    def prior(self) -> Prior: ...
    @property
    def algorithm(self) -> Move: ...
    @property
    def n_particles(self) -> int | None: ...
    @property
    def kind(self) -> Kind: ...

    def rebuilt(self, **components: Any) -> Self:
        """Return it with other components, such as the prior, the algorithm or n_particles."""


@dataclass(frozen=True, eq=False)
class Wrapper:
    """Base of inference methods that wrap a filter.

    n_particles: replaces the filter's. wraps: kinds of steps that it accepts. kind: of its own steps. Raises InputError
    for other steps.
    """

    @staticmethod
    def traits(keys: Mapping[str, Any]) -> Traits:
        """Declare the filter's traits."""
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
        """Return the filter's prior."""
        return self.filter.prior

    @property
    def algorithm(self) -> Move:
        """Return the filter's move."""
        return self.filter.algorithm

    @property
    def space(self) -> StateSpace:
        """Return the filter's state space."""
        return self.filter.space

    @property
    def finds_start(self) -> bool:
        """Return whether the filter estimates the initial pose itself."""
        return self.filter.finds_start

    def rebuilt(self, **components: Any) -> Self:
        """Return it with other components of the particle filter, such as the prior, the algorithm or n_particles."""
        return replace(self, filter=self.filter.rebuilt(**components), n_particles=None)
