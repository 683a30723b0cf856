"""A part of the body by a prior of its own, while the rest follows a motion that is known."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from workbench.body.skeleton import POSE_NAMES
from workbench.core.capabilities import DENSITY, KEYPOINTS, Traits, needs_of_all, offering
from workbench.core.keys import records_arguments
from workbench.core.prior import Prior, PriorCapabilities
from workbench.core.side_information import FIXED_OTHER_JOINTS, TRAJECTORY
from workbench.priors.density import Appended
from workbench.utils.arrays import FloatArray


@dataclass(frozen=True, eq=False)
class Trajectory:
    """Poses (F, P) at times (F,), s, since the first of them."""

    times_s: FloatArray
    poses: FloatArray


@records_arguments
class FittedRest(Appended):
    """Another prior's parameters, with all others as a known trajectory has them: an arm of a balancing person.

    A state is the base prior's and then `time`, s since the trajectory's first pose; between its poses parameters are
    linear, after the last they stay. The trajectory has no spread, and `parameters` are the base's alone.

    base: moves the part that is tracked. trajectory: gives the whole body's motion, when first asked.
    """

    @staticmethod
    def traits(keys: Mapping[str, Any]) -> Traits:
        """Declare the base's density, and that the rest of the body follows detected joints."""
        base: Traits = keys["base"]
        needs = needs_of_all({"base": base, "rest": offering(dataset=KEYPOINTS, given=TRAJECTORY)})
        needs["given"] -= {FIXED_OTHER_JOINTS}
        return Traits(base.provides & {DENSITY}, needs, base.missing)

    def __init__(self, base: Prior, trajectory: Callable[[], Trajectory]) -> None:
        super().__init__(base, "time", ("time",), "s")
        self._ask, self.parameters = trajectory, base.parameters
        self._followed = [i for i, name in enumerate(POSE_NAMES) if name not in base.parameters]

    @cached_property
    def trajectory(self) -> Trajectory:
        """The whole body's motion."""
        return self._ask()

    @property
    def capabilities(self) -> PriorCapabilities:
        """The base's density, and where the trajectory begins."""
        return PriorCapabilities(density=self.density(), first_pose=lambda: self.trajectory.poses[0])

    def sample_initial(self, pose: FloatArray, n: int, rng: np.random.Generator) -> FloatArray:
        """N states (N, D) around a starting pose (P,), when the trajectory begins."""
        return np.concatenate([self.base.sample_initial(pose, n, rng), np.zeros((n, 1))], axis=1)

    def transition(self, dt_s: float) -> tuple[float, float, float]:
        """Let the time go on."""
        return 1.0, dt_s, 0.0

    def pose(self, state: FloatArray) -> FloatArray:
        """The poses (N, P) of states (N, D)."""
        poses = self.base.pose(self.of_base(state)).copy()
        for i in self._followed:
            poses[:, i] = np.interp(state[:, -1], self.trajectory.times_s, self.trajectory.poses[:, i])
        return poses
