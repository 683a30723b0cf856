"""Building blocks of the priors' transition densities, and a base class that appends autoregressive columns."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields

import numpy as np

from workbench.core.prior import Density, Prior, Smoothness, propose
from workbench.core.state_space import StateSpace
from workbench.utils.arrays import FloatArray, IntArray
from workbench.utils.errors import InputError

REFERENCE_RATE_HZ = 30.0  # frame rate of the priors' noise parameters
SAME = 1e-9  # tolerance within which columns without noise count as unchanged, in their unit


def whole_frames(dt_s: float, rate_hz: float) -> int | None:
    """Return the number of frames at `rate_hz` in `dt_s` seconds, at least 1; None if not whole to 5 % of a frame."""
    frames = dt_s * rate_hz
    return None if round(frames) < 1 or abs(frames - round(frames)) > 0.05 else round(frames)


class AllColumnsFree:
    """Part of a `Density` whose columns are all free: none depends on the others."""

    space: StateSpace

    @property
    def free(self) -> IntArray:
        """All columns (D,)."""
        return np.arange(len(self.space))

    def sample_dependent(
        self, previous: FloatArray, state: FloatArray, dt_s: float, rng: np.random.Generator
    ) -> FloatArray:
        """Return the states (N, D) unchanged."""
        return state


def by_column(space: StateSpace, **groups: float | Sequence[float] | FloatArray) -> FloatArray:
    """Return values by column (D,): one or several for each named group, zero elsewhere."""
    columns = np.zeros(len(space))
    for group, values in groups.items():
        columns[space.slices[group]] = values
    return columns


def phase_columns(space: StateSpace) -> list[int]:
    """Return the columns that are phases in cycles, where 0 and 1 are equivalent."""
    return [i for i, unit in enumerate(space.units) if unit == "cycle"]


def state_difference(space: StateSpace, first: FloatArray, second: FloatArray) -> FloatArray:
    """Return second − first, (..., D), of states (..., D) that broadcast; phases are wrapped to ±1/2 cycle."""
    difference: FloatArray = second - first
    phases = phase_columns(space)
    difference[..., phases] -= np.round(difference[..., phases])
    return difference


def log_normal(deviation: FloatArray, sigma: FloatArray) -> FloatArray:
    """Return log N(deviation; 0, diag σ²), (...), of deviations (..., D) for σ (D,).

    Columns with σ = 0 have no density: they contribute 0 if the deviation is zero, and −∞ otherwise.
    """
    free = sigma > 0.0
    whitened = deviation[..., free] / sigma[free]
    density: FloatArray = -0.5 * (whitened**2).sum(axis=-1) - float(np.log(np.sqrt(2.0 * np.pi) * sigma[free]).sum())
    if not free.all():
        density = np.where((np.abs(deviation[..., ~free]) <= SAME).all(axis=-1), density, -np.inf)
    return density


def smoothness(penalty: Mapping[str, float] | None) -> Smoothness:
    """Return a `Smoothness` with the fields in `penalty`, which are positive; the others have their defaults.

    Raises InputError for an unknown field, or a value that is not a positive number.
    """
    values, names = dict(penalty or {}), [field.name for field in fields(Smoothness) if field.name != "angles"]
    for name, value in values.items():
        if name not in names:
            raise InputError(f"prior: penalty: expected some of {', '.join(names)}, found {name!r}")
        if not 0.0 < value < np.inf:
            raise InputError(f"prior: penalty.{name} must be a positive number, found {value}")
    return Smoothness(**values)  # type: ignore[arg-type]  # numbers alone


class AppendedColumns:
    """A base prior's states followed by k columns x of one group and unit, each with x_t ~ N(a x_t−1 + b, σ²).

    No random numbers are drawn for them if σ is zero.
    """

    def __init__(self, base: Prior, group: str, columns: tuple[str, ...], unit: str) -> None:
        self.base = base
        self.space = base.space.appended(group, columns, (unit,) * len(columns))
        self.appended = self.space.slices[group]

    def transition(self, dt_s: float) -> tuple[FloatArray | float, float, FloatArray | float]:
        """Return a, b and σ of the appended columns, scalars or (k,), after `dt_s` seconds."""
        raise NotImplementedError

    def sample_transition(self, state: FloatArray, dt_s: float, rng: np.random.Generator) -> FloatArray:
        """Sample from p(state_t | state_t−1), (N, D), once for each state (N, D), `dt_s` seconds later."""
        return self._with_columns(self.base.sample_transition(self.base_state(state), dt_s, rng), state, dt_s, rng)

    def propose(self, state: FloatArray, dt_s: float, rng: np.random.Generator) -> tuple[FloatArray, FloatArray]:
        """Sample states (N, D) from the base's proposal, if any; return them with log importance weights (N,)."""
        base_state, log_weights = propose(self.base, self.base_state(state), dt_s, rng)
        return self._with_columns(base_state, state, dt_s, rng), log_weights

    def base_state(self, state: FloatArray) -> FloatArray:
        """Return the base's columns of states (..., D)."""
        return np.ascontiguousarray(state[..., : self.appended.start])

    def density(self) -> "_AppendedDensity | None":
        """Return the transition density; None if the base has none."""
        base = self.base.capabilities.density
        return None if base is None else _AppendedDensity(self, base)

    def _with_columns(
        self, base_state: FloatArray, previous: FloatArray, dt_s: float, rng: np.random.Generator
    ) -> FloatArray:
        a, b, sigma = self.transition(dt_s)
        columns = a * previous[:, self.appended] + b
        if np.any(sigma):
            columns = columns + sigma * rng.standard_normal(columns.shape)
        return np.concatenate([base_state, columns], axis=1)


@dataclass(frozen=True, eq=False)
class _AppendedDensity:
    """The density of a base prior times that of the appended columns, which are independent of it."""

    prior: AppendedColumns
    base: Density

    @property
    def free(self) -> IntArray:
        """The base's free columns and all appended ones."""
        return np.concatenate([self.base.free, np.arange(self.prior.appended.start, self.prior.appended.stop)])

    def mean(self, state: FloatArray, dt_s: float) -> FloatArray:
        """Return the noise-free prediction (N, D) of states (N, D) after `dt_s` seconds."""
        a, b, _ = self.prior.transition(dt_s)
        base_mean = self.base.mean(self.prior.base_state(state), dt_s)
        return np.concatenate([base_mean, a * state[:, self.prior.appended] + b], axis=1)

    def log_transition(self, previous: FloatArray, state: FloatArray, dt_s: float) -> FloatArray:
        """Return log p(state | previous), (...), of states (..., D) that broadcast.

        It is −∞ where columns without noise differ from their prediction.
        """
        a, b, sigma = self.prior.transition(dt_s)
        change = state[..., self.prior.appended] - a * previous[..., self.prior.appended] - b
        log_base = self.base.log_transition(self.prior.base_state(previous), self.prior.base_state(state), dt_s)
        return log_base + log_normal(change, np.full(change.shape[-1], sigma))

    def sample_dependent(
        self, previous: FloatArray, state: FloatArray, dt_s: float, rng: np.random.Generator
    ) -> FloatArray:
        """Return the states (N, D) with the base's dependent columns sampled given the free ones."""
        prior = self.prior
        base_state = self.base.sample_dependent(prior.base_state(previous), prior.base_state(state), dt_s, rng)
        return np.concatenate([base_state, state[:, prior.appended]], axis=1)
