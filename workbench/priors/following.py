"""A part of the body by a prior of its own, while the rest follows a motion that is known."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from workbench.arrays import FloatArray, IntArray
from workbench.body.skeleton import POSE_NAMES
from workbench.core.prior import Density, Powers, Prior, propose
from workbench.core.state_space import StateSpace
from workbench.core.traits import DENSITY, KEYPOINTS, Traits, needs_of_all, offering
from workbench.priors.density import SAME


@dataclass(frozen=True, eq=False)
class Trajectory:
    """Poses (F, P) at times (F,), s, since the first of them."""

    times_s: FloatArray
    poses: FloatArray


class Following:
    """Another prior's parameters, with all others as a known trajectory has them: an arm of somebody who balances.

    A state is the base prior's and then `time`, s since the trajectory's first pose, so that a state alone stands for a
    pose; between poses parameters are linear, after the last they stay. What follows is no random quantity: it has no
    spread, and `parameters` are the base's alone.

    base: moves the part that is tracked. trajectory: gives the whole body's motion, when first asked.
    """

    @staticmethod
    def traits(keys: Mapping[str, Any]) -> Traits:
        """Declare the base's density, and that the rest of the body follows detected joints."""
        base: Traits = keys["base"]
        needs = needs_of_all({"base": base, "rest": offering(dataset=KEYPOINTS)})
        return Traits(base.offers & {DENSITY}, needs, base.lacks)

    def __init__(self, base: Prior, trajectory: Callable[[], Trajectory]) -> None:
        self.base, self._ask = base, trajectory
        self.parameters = base.parameters
        self._followed = [i for i, name in enumerate(POSE_NAMES) if name not in base.parameters]
        self.space = StateSpace(
            (*base.space.names, "time"), (*base.space.units, "s"),
            {**base.space.slices, "time": slice(len(base.space), len(base.space) + 1)},
        )  # fmt: skip

    @cached_property
    def trajectory(self) -> Trajectory:
        """The whole body's motion."""
        return self._ask()

    @property
    def powers(self) -> Powers:
        """The base's density, and where the trajectory begins."""
        base = self.base.powers.density
        density = None if base is None else FollowingDensity(self, base)
        return Powers(density=density, first_pose=lambda: self.trajectory.poses[0])

    def start(self, pose: FloatArray, n: int, rng: np.random.Generator) -> FloatArray:
        """N states (N, D) around a starting pose (P,), when the trajectory begins."""
        return np.concatenate([self.base.start(pose, n, rng), np.zeros((n, 1))], axis=1)

    def step(self, state: FloatArray, dt_s: float, rng: np.random.Generator) -> FloatArray:
        """One draw from p(state_t | state_t−1) for each of (N, D) states, `dt_s` seconds later."""
        return np.concatenate([self.base.step(self.of_base(state), dt_s, rng), state[:, -1:] + dt_s], axis=1)

    def propose(self, state: FloatArray, dt_s: float, rng: np.random.Generator) -> tuple[FloatArray, FloatArray]:
        """Draws (N, D) by the base's proposal, and the log weights (N,) that correct for it."""
        moved, correction = propose(self.base, self.of_base(state), dt_s, rng)
        return np.concatenate([moved, state[:, -1:] + dt_s], axis=1), correction

    def pose(self, state: FloatArray) -> FloatArray:
        """The poses (N, P) of states (N, D)."""
        poses = self.base.pose(self.of_base(state)).copy()
        for i in self._followed:
            poses[:, i] = np.interp(state[:, -1], self.trajectory.times_s, self.trajectory.poses[:, i])
        return poses

    def of_base(self, state: FloatArray) -> FloatArray:
        """The base's part of states (..., D)."""
        return np.ascontiguousarray(state[..., :-1])


@dataclass(frozen=True, eq=False)
class FollowingDensity:
    """The density of a base prior, with a time that goes on without noise."""

    prior: Following
    base: Density

    @property
    def free(self) -> IntArray:
        """The base's free columns and the time, which has no noise."""
        return np.append(self.base.free, len(self.prior.space) - 1)

    def mean(self, state: FloatArray, dt_s: float) -> FloatArray:
        """Predict where states (N, D) are `dt_s` seconds later when the noise is zero, (N, D)."""
        return np.concatenate([self.base.mean(self.prior.of_base(state), dt_s), state[:, -1:] + dt_s], axis=1)

    def log_transition(self, previous: FloatArray, state: FloatArray, dt_s: float) -> FloatArray:
        """log p(state | previous), (...), of states (..., D) that broadcast: −∞ at another time than `dt_s` later."""
        in_time = np.abs(state[..., -1] - previous[..., -1] - dt_s) <= SAME
        density = self.base.log_transition(self.prior.of_base(previous), self.prior.of_base(state), dt_s)
        return np.where(in_time, density, -np.inf)

    def complete(self, previous: FloatArray, state: FloatArray, dt_s: float, rng: np.random.Generator) -> FloatArray:
        """The states (N, D) with the base's columns that follow from others drawn given those."""
        completed = self.base.complete(self.prior.of_base(previous), self.prior.of_base(state), dt_s, rng)
        return np.concatenate([completed, state[:, -1:]], axis=1)
