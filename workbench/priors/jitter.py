"""Freedom for every joint on top of a linear model of motion, so that unusual arms can be followed."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from workbench.arrays import FloatArray, IntArray
from workbench.body.skeleton import POSE_NAMES
from workbench.body.skeleton import parameters as named_parameters
from workbench.core.prior import Density, Powers, Prior, propose
from workbench.core.state_space import StateSpace
from workbench.core.traits import ACTIVITY, BODY_PARTS, LIMB_COLUMNS, SEPARABLE, Traits
from workbench.errors import InputError
from workbench.priors.density import REFERENCE_RATE_HZ, log_normal


class Jitter:
    """The pose of another prior plus an offset δ for each of k joint angles, which returns to zero:

        δ_t = keep^n δ_t−1 + N(0, σ² (1 − keep^2n) / (1 − keep²)),  n = Δt · 30 Hz

    A first-order autoregression (AR), whose deviation in the long run is σ / √(1 − keep²), 0.046 rad as it stands. A
    linear model of walking knows no other swing of the arms than it was shown; its own error on a person it was not
    learned from is of this size, so that without the offsets its posterior is too sure of itself.

    A state is the base prior's and then the k offsets, "<parameter>_jitter".

    base: the other prior. sigma: rad per frame at 30 Hz. keep: what is left of an offset after such a frame.
    parameters: names of joint angles or of body parts (`skeleton.PARTS`); None: all that the base moves but the root.
    Raises InputError for numbers out of range, and for parameters of the root.
    """

    @staticmethod
    def traits(keys: Mapping[str, Any]) -> Traits:
        """Declare what the base offers, and columns for every joint of their own."""
        base: Traits = keys["base"]
        parts = {LIMB_COLUMNS, *({BODY_PARTS} if SEPARABLE in base.offers else ())}
        return replace(base, offers=(base.offers - {ACTIVITY}) | parts)

    def __init__(
        self, base: Prior, *, sigma: float = 0.02, keep: float = 0.9, parameters: Sequence[str] | None = None
    ) -> None:
        if not (0.0 < sigma < np.inf and 0.0 <= keep < 1.0):
            raise InputError(f"prior: expected sigma above 0 and keep from 0 to below 1, found {sigma} and {keep}")
        names = base.parameters if parameters is None else named_parameters("prior: parameters", parameters)
        self.names = tuple(name for name in names if not name.startswith("root_"))
        if parameters is not None and len(self.names) < len(names):
            raise InputError("prior: parameters must be joint angles, found some of the root")
        if unknown := [name for name in base.parameters if name not in POSE_NAMES]:
            raise InputError(f"prior: jitter knows the person's 25 parameters, its base moves {unknown[0]}")
        self.base, self.sigma, self.keep = base, sigma, keep
        self.parameters = tuple(name for name in POSE_NAMES if name in {*base.parameters, *self.names})
        self._angles = [POSE_NAMES.index(name) for name in self.names]
        d = len(base.space)
        self._base, self.offsets = slice(0, d), slice(d, d + len(self.names))
        self.space = StateSpace(
            (*base.space.names, *(f"{name}_jitter" for name in self.names)),
            (*base.space.units, *["rad"] * len(self.names)),
            {**base.space.slices, "jitter": self.offsets},
        )

    @property
    def powers(self) -> Powers:
        """Those of the base: its density with the offsets', and its motion without them, which still finds a start.

        No smoothness, so that no fit takes the motion for all that this prior says.
        """
        powers = self.base.powers
        density = None if powers.density is None else JitterDensity(self, powers.density)
        return replace(powers, density=density, smoothness=None)

    def start(self, pose: FloatArray, n: int, rng: np.random.Generator) -> FloatArray:
        """N states (N, D): the base's around a starting pose (P,), with offsets as they are in the long run.

        The offsets are not fitted to the pose: what the base misses of it, they have to find.
        """
        state = self.base.start(pose, n, rng)
        offsets = self.sigma / np.sqrt(1.0 - self.keep**2) * rng.standard_normal((n, len(self.names)))
        return np.concatenate([state, offsets], axis=1)

    def step(self, state: FloatArray, dt_s: float, rng: np.random.Generator) -> FloatArray:
        """One draw from p(state_t | state_t−1) for each of (N, D) states, `dt_s` seconds later."""
        moved = self.base.step(self.of_base(state), dt_s, rng)
        return np.concatenate([moved, self._jittered(state, dt_s, rng)], axis=1)

    def propose(self, state: FloatArray, dt_s: float, rng: np.random.Generator) -> tuple[FloatArray, FloatArray]:
        """Draws (N, D), by the base's proposal where it has one, and the log weights (N,) that correct for it."""
        moved, correction = propose(self.base, self.of_base(state), dt_s, rng)
        return np.concatenate([moved, self._jittered(state, dt_s, rng)], axis=1), correction

    def pose(self, state: FloatArray) -> FloatArray:
        """The poses (N, P) of states (N, D)."""
        poses = self.base.pose(self.of_base(state)).copy()
        poses[:, self._angles] += state[:, self.offsets]
        return poses

    def autoregression(self, dt_s: float) -> tuple[float, float]:
        """Tell what is left of an offset after `dt_s` seconds, and the deviation of the noise that came to it."""
        kept = self.keep ** (dt_s * REFERENCE_RATE_HZ)
        return kept, self.sigma * float(np.sqrt((1.0 - kept**2) / (1.0 - self.keep**2)))

    def _jittered(self, state: FloatArray, dt_s: float, rng: np.random.Generator) -> FloatArray:
        kept, sigma = self.autoregression(dt_s)
        offsets = state[:, self.offsets]
        moved: FloatArray = kept * offsets + sigma * rng.standard_normal(offsets.shape)
        return moved

    def of_base(self, state: FloatArray) -> FloatArray:
        """The base's part of states (..., D)."""
        return np.ascontiguousarray(state[..., self._base])


@dataclass(frozen=True, eq=False)
class JitterDensity:
    """The density of a base prior times that of the offsets, which are independent of it."""

    prior: Jitter
    base: Density

    @property
    def free(self) -> IntArray:
        """The base's free columns and all offsets."""
        offsets = self.prior.offsets
        return np.concatenate([self.base.free, np.arange(offsets.start, offsets.stop)])

    def mean(self, state: FloatArray, dt_s: float) -> FloatArray:
        """Predict where states (N, D) are `dt_s` seconds later when the noise is zero, (N, D)."""
        kept, _ = self.prior.autoregression(dt_s)
        moved = self.base.mean(self.prior.of_base(state), dt_s)
        return np.concatenate([moved, kept * state[:, self.prior.offsets]], axis=1)

    def log_transition(self, previous: FloatArray, state: FloatArray, dt_s: float) -> FloatArray:
        """log p(state | previous), (...), of states (..., D) that broadcast."""
        kept, sigma = self.prior.autoregression(dt_s)
        offsets = self.prior.offsets
        change = state[..., offsets] - kept * previous[..., offsets]
        of_base = self.base.log_transition(self.prior.of_base(previous), self.prior.of_base(state), dt_s)
        return of_base + log_normal(change, np.full(len(self.prior.names), sigma))

    def complete(self, previous: FloatArray, state: FloatArray, dt_s: float, rng: np.random.Generator) -> FloatArray:
        """The states (N, D) with the base's columns that follow from others drawn given those."""
        completed = self.base.complete(self.prior.of_base(previous), self.prior.of_base(state), dt_s, rng)
        return np.concatenate([completed, state[:, self.prior.offsets]], axis=1)
