"""Another prior's states with columns of their own behind them, which go on independently."""

from dataclasses import dataclass

import numpy as np

from workbench.core.prior import Density, Prior, propose
from workbench.priors.density import log_normal
from workbench.utils.arrays import FloatArray, IntArray


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

    def step(self, state: FloatArray, dt_s: float, rng: np.random.Generator) -> FloatArray:
        """One draw from p(state_t | state_t−1) for each of (N, D) states, `dt_s` seconds later."""
        return self._appended(self.base.step(self.of_base(state), dt_s, rng), state, dt_s, rng)

    def propose(self, state: FloatArray, dt_s: float, rng: np.random.Generator) -> tuple[FloatArray, FloatArray]:
        """Draws (N, D), by the base's proposal where it has one, and the log weights (N,) that correct for it."""
        moved, correction = propose(self.base, self.of_base(state), dt_s, rng)
        return self._appended(moved, state, dt_s, rng), correction

    def of_base(self, state: FloatArray) -> FloatArray:
        """The base's part of states (..., D)."""
        return np.ascontiguousarray(state[..., : self.own.start])

    def density(self) -> "AppendedDensity | None":
        """Return the density, where the base has one."""
        base = self.base.powers.density
        return None if base is None else AppendedDensity(self, base)

    def _appended(self, moved: FloatArray, state: FloatArray, dt_s: float, rng: np.random.Generator) -> FloatArray:
        a, b, sigma = self.transition(dt_s)
        own = a * state[:, self.own] + b
        if np.any(sigma):
            own = own + sigma * rng.standard_normal(own.shape)
        return np.concatenate([moved, own], axis=1)


@dataclass(frozen=True, eq=False)
class AppendedDensity:
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

    def complete(self, previous: FloatArray, state: FloatArray, dt_s: float, rng: np.random.Generator) -> FloatArray:
        """Return the states (N, D) with the base's columns that follow from others drawn given those."""
        completed = self.base.complete(self.prior.of_base(previous), self.prior.of_base(state), dt_s, rng)
        return np.concatenate([completed, state[:, self.prior.own]], axis=1)
