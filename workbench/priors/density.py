"""What the densities and the penalties of priors are made of; a prior with independent columns of its own behind."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields

import numpy as np

from workbench.core.prior import Density, Prior, Smoothness, propose
from workbench.core.state_space import StateSpace
from workbench.utils.arrays import FloatArray, IntArray
from workbench.utils.errors import InputError

REFERENCE_RATE_HZ = 30.0  # the frames a second for which priors are given their noise
SAME = 1e-9  # columns without noise are where they were to this, in their unit


def whole_frames(dt_s: float, rate_hz: float) -> int | None:
    """Count the frames at rate_hz in dt_s seconds; None unless it is a whole number from 1 on (to 5 % of a frame)."""
    frames = dt_s * rate_hz
    return None if round(frames) < 1 or abs(frames - round(frames)) > 0.05 else round(frames)


class AllFree:
    """The part of a `Density` that says that no column of the prior's space follows from others."""

    space: StateSpace

    @property
    def free(self) -> IntArray:
        """All columns (D,)."""
        return np.arange(len(self.space))

    def sample_dependent(
        self, previous: FloatArray, state: FloatArray, dt_s: float, rng: np.random.Generator
    ) -> FloatArray:
        """Return the states (N, D) as they are."""
        return state


def by_column(space: StateSpace, **groups: float | Sequence[float] | FloatArray) -> FloatArray:
    """Lay out values by column (D,): one or several for every group that is named, zero elsewhere."""
    columns = np.zeros(len(space))
    for group, values in groups.items():
        columns[space.slices[group]] = values
    return columns


def circular(space: StateSpace) -> list[int]:
    """Find the columns that are phases, counted in cycles: 0 and 1 are the same."""
    return [i for i, unit in enumerate(space.units) if unit == "cycle"]


def apart(space: StateSpace, first: FloatArray, second: FloatArray) -> FloatArray:
    """second − first, (..., D), of states (..., D) that broadcast; phases by the shortest way round, ±1/2 cycle."""
    difference: FloatArray = second - first
    phases = circular(space)
    difference[..., phases] -= np.round(difference[..., phases])
    return difference


def log_normal(deviation: FloatArray, sigma: FloatArray) -> FloatArray:
    """log N(deviation; 0, diag σ²), (...), of deviations (..., D) for σ (D,).

    Columns with σ = 0 have no density: they add nothing where the deviation is zero, and make it −∞ where not.
    """
    free = sigma > 0.0
    white = deviation[..., free] / sigma[free]
    density: FloatArray = -0.5 * (white**2).sum(axis=-1) - float(np.log(np.sqrt(2.0 * np.pi) * sigma[free]).sum())
    if not free.all():
        density = np.where((np.abs(deviation[..., ~free]) <= SAME).all(axis=-1), density, -np.inf)
    return density


def smoothness(penalty: Mapping[str, float] | None) -> Smoothness:
    """Return `Smoothness` with the fields that are given, positive numbers; the others keep their defaults.

    Raises InputError for an unknown field and for a number that is none or not positive.
    """
    given, known = dict(penalty or {}), [field.name for field in fields(Smoothness)]
    for name, value in given.items():
        if name not in known:
            raise InputError(f"prior: penalty: expected some of {', '.join(known)}, found {name!r}")
        if not 0.0 < value < np.inf:
            raise InputError(f"prior: penalty.{name} must be a positive number, found {value}")
    return Smoothness(**given)


class Appended:
    """A base prior's states and then k columns x of one group and unit, each with x_t ~ N(a x_t−1 + b, σ²).

    Where σ is zero nothing is drawn for them.
    """

    def __init__(self, base: Prior, group: str, columns: tuple[str, ...], unit: str) -> None:
        self.base = base
        self.space = base.space.appended(group, columns, (unit,) * len(columns))
        self.own = self.space.slices[group]

    def transition(self, dt_s: float) -> tuple[FloatArray | float, float, FloatArray | float]:
        """Return a, b and σ of the own columns, one for all or (k,), after `dt_s` seconds."""
        raise NotImplementedError

    def sample_transition(self, state: FloatArray, dt_s: float, rng: np.random.Generator) -> FloatArray:
        """One draw from p(state_t | state_t−1) for each of (N, D) states, `dt_s` seconds later."""
        return self._appended(self.base.sample_transition(self.of_base(state), dt_s, rng), state, dt_s, rng)

    def propose(self, state: FloatArray, dt_s: float, rng: np.random.Generator) -> tuple[FloatArray, FloatArray]:
        """Draws (N, D), by the base's proposal where it has one, and the log weights (N,) that correct for it."""
        moved, correction = propose(self.base, self.of_base(state), dt_s, rng)
        return self._appended(moved, state, dt_s, rng), correction

    def of_base(self, state: FloatArray) -> FloatArray:
        """The base's part of states (..., D)."""
        return np.ascontiguousarray(state[..., : self.own.start])

    def density(self) -> "_AppendedDensity | None":
        """Return the density, where the base has one."""
        base = self.base.capabilities.density
        return None if base is None else _AppendedDensity(self, base)

    def _appended(self, moved: FloatArray, state: FloatArray, dt_s: float, rng: np.random.Generator) -> FloatArray:
        a, b, sigma = self.transition(dt_s)
        own = a * state[:, self.own] + b
        if np.any(sigma):
            own = own + sigma * rng.standard_normal(own.shape)
        return np.concatenate([moved, own], axis=1)


@dataclass(frozen=True, eq=False)
class _AppendedDensity:
    """The density of a base prior times that of the appended columns, which are independent of it."""

    prior: Appended
    base: Density

    @property
    def free(self) -> IntArray:
        """The base's free columns and all appended ones."""
        return np.concatenate([self.base.free, np.arange(self.prior.own.start, self.prior.own.stop)])

    def mean(self, state: FloatArray, dt_s: float) -> FloatArray:
        """Predict where states (N, D) are `dt_s` seconds later when the noise is zero, (N, D)."""
        a, b, _ = self.prior.transition(dt_s)
        return np.concatenate(
            [self.base.mean(self.prior.of_base(state), dt_s), a * state[:, self.prior.own] + b], axis=1
        )

    def log_transition(self, previous: FloatArray, state: FloatArray, dt_s: float) -> FloatArray:
        """log p(state | previous), (...), of states (..., D) that broadcast: −∞ where columns without noise differ."""
        a, b, sigma = self.prior.transition(dt_s)
        change = state[..., self.prior.own] - a * previous[..., self.prior.own] - b
        of_base = self.base.log_transition(self.prior.of_base(previous), self.prior.of_base(state), dt_s)
        return of_base + log_normal(change, np.full(change.shape[-1], sigma))

    def sample_dependent(
        self, previous: FloatArray, state: FloatArray, dt_s: float, rng: np.random.Generator
    ) -> FloatArray:
        """Return the states (N, D) with the base's columns that follow from others drawn given those."""
        completed = self.base.sample_dependent(self.prior.of_base(previous), self.prior.of_base(state), dt_s, rng)
        return np.concatenate([completed, state[:, self.prior.own]], axis=1)
