"""What stands around a particle filter: it runs the filter and makes something else of its steps."""

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, field, replace
from typing import Any, ClassVar, Literal, Protocol, Self, TypeAlias

from workbench.core.capabilities import Traits
from workbench.core.filter_state import Past
from workbench.core.frame import Frame
from workbench.core.prior import Prior
from workbench.core.state_space import StateSpace
from workbench.core.step import Inference, Step
from workbench.inference.smc.move import Move, Streams
from workbench.utils.arrays import FloatArray
from workbench.utils.errors import InputError

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
    def continues(self) -> bool: ...

    def rebuilt(self, **parts: Any) -> Self:
        """Replace parts of the particle filter, such as the prior, the move or n_particles."""

    def run(self, frames: Iterable[Frame], start: FloatArray | Past | None, rng_streams: Streams) -> Iterator[Step]:
        """Yield one step per frame, or for those after a past, see `Continuing`."""


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
        """Tell whether the filter finds the first pose itself."""
        return self.filter.finds_start

    @property
    def continues(self) -> bool:
        """Tell whether the filter can go on from a past; what has to see all frames first cannot."""
        return self.filter.continues

    def rebuilt(self, **parts: Any) -> Self:
        """Replace parts of the particle filter, such as the prior, the move or n_particles."""
        return replace(self, filter=self.filter.rebuilt(**parts), n_particles=None)
