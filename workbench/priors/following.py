"""A part of the body by a prior of its own, while the rest follows a motion that is known."""

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from workbench.arrays import FloatArray
from workbench.body.skeleton import POSE_NAMES
from workbench.priors.state import Prior, StateSpace, propose


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

    def start(self, pose: FloatArray, n: int, rng: np.random.Generator) -> FloatArray:
        """N states (N, D) around a starting pose (P,), when the trajectory begins."""
        return np.concatenate([self.base.start(pose, n, rng), np.zeros((n, 1))], axis=1)

    def step(self, state: FloatArray, dt_s: float, rng: np.random.Generator) -> FloatArray:
        """One draw from p(state_t | state_t−1) for each of (N, D) states, `dt_s` seconds later."""
        return np.concatenate([self.base.step(self._of_base(state), dt_s, rng), state[:, -1:] + dt_s], axis=1)

    def propose(self, state: FloatArray, dt_s: float, rng: np.random.Generator) -> tuple[FloatArray, FloatArray]:
        """Draws (N, D) by the base's proposal, and the log weights (N,) that correct for it."""
        moved, correction = propose(self.base, self._of_base(state), dt_s, rng)
        return np.concatenate([moved, state[:, -1:] + dt_s], axis=1), correction

    def pose(self, state: FloatArray) -> FloatArray:
        """The poses (N, P) of states (N, D)."""
        poses = self.base.pose(self._of_base(state)).copy()
        for i in self._followed:
            poses[:, i] = np.interp(state[:, -1], self.trajectory.times_s, self.trajectory.poses[:, i])
        return poses

    def _of_base(self, state: FloatArray) -> FloatArray:
        return np.ascontiguousarray(state[:, :-1])
