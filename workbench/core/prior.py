"""The names of a state's columns, and what every prior offers."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Protocol, runtime_checkable

import numpy as np

from workbench.arrays import FloatArray


@dataclass(frozen=True)
class StateSpace:
    """Names the D columns of a packed (N, D) particle array.

    names, units: one per column. slices: named groups of columns, e.g. "coefficients", "phase", "root".
    """

    names: tuple[str, ...]
    units: tuple[str, ...]
    slices: Mapping[str, slice]

    def __len__(self) -> int:
        return len(self.names)

    @staticmethod
    def of(groups: Mapping[str, tuple[tuple[str, ...], str]]) -> "StateSpace":
        """A state space from {group: (column names, unit)}, the groups side by side in the order given."""
        names: list[str] = []
        units: list[str] = []
        slices: dict[str, slice] = {}
        for group, (columns, unit) in groups.items():
            slices[group] = slice(len(names), len(names) + len(columns))
            names += columns
            units += [unit] * len(columns)
        return StateSpace(tuple(names), tuple(units), slices)


class Prior(Protocol):
    """Temporal prior p(state_t | state_t−1) over N particles of size D that decode to poses of size P."""

    @property
    def space(self) -> StateSpace:
        """Names and units of the D columns."""

    @property
    def parameters(self) -> tuple[str, ...]:
        """Names of the pose's parameters that move; the others stay as they start, or go as is known of them."""

    def start(self, pose: FloatArray, n: int, rng: np.random.Generator) -> FloatArray:
        """N states (N, D) spread around a starting pose (P,)."""

    def step(self, state: FloatArray, dt_s: float, rng: np.random.Generator) -> FloatArray:
        """One draw (N, D) from p(state_t | state_t−1) for each state (N, D), `dt_s` seconds later."""

    def pose(self, state: FloatArray) -> FloatArray:
        """The poses (N, P) that states (N, D) stand for."""


@runtime_checkable
class Proposing(Protocol):
    """A prior that draws from a proposal and says by which weights its draws stand for the prior."""

    def propose(self, state: FloatArray, dt_s: float, rng: np.random.Generator) -> tuple[FloatArray, FloatArray]:
        """States (N, D), `dt_s` seconds later, and the log weights (N,) that correct for where they were drawn."""


@runtime_checkable
class WithDensity(Protocol):
    """A prior whose p(state_t | state_t−1) can be evaluated, which backward smoothing and MCMC moves need."""

    def mean(self, state: FloatArray, dt_s: float) -> FloatArray:
        """Where states (N, D) are `dt_s` seconds later when the noise is zero, (N, D)."""

    def log_transition(self, previous: FloatArray, state: FloatArray, dt_s: float) -> FloatArray:
        """log p(state | previous), (...), of states (..., D) `dt_s` seconds apart, which broadcast.

        Columns without noise have no density: log p is −∞ where they are not as the previous state says.
        """


def propose(prior: Prior, state: FloatArray, dt_s: float, rng: np.random.Generator) -> tuple[FloatArray, FloatArray]:
    """By the prior's own proposal, or where it has none by `step`, whose draws (N, D) have log weights (N,) of zero."""
    if isinstance(prior, Proposing):
        return prior.propose(state, dt_s, rng)
    return prior.step(state, dt_s, rng), np.zeros(len(state))
