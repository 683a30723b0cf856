"""One body part by a prior of its own, while the rest of the body follows a fitted trajectory."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from workbench.body.skeleton import POSE_NAMES
from workbench.core.capabilities import DENSITY, KEYPOINTS, Traits, combined_requirements, component_traits
from workbench.core.prior import Prior, PriorCapabilities
from workbench.core.side_information import FIXED_OTHER_JOINTS, TRAJECTORY
from workbench.priors.density import AppendedColumns
from workbench.utils.arrays import FloatArray


@dataclass(frozen=True, eq=False)
class Trajectory:
    """Poses (F, P) at times (F,), s, since the first of them."""

    times_s: FloatArray
    poses: FloatArray


class FittedRest(AppendedColumns):
    """Another prior for some parameters, and a fitted trajectory for the others, e.g. an arm of a balancing person.

    A state is the base prior's followed by `time`, s since the trajectory's first pose. Between its poses the
    parameters are interpolated linearly; after the last they are constant. The trajectory has no uncertainty, and
    `parameters` are the base's alone. base : prior of the tracked body part. trajectory : returns the motion of the
    whole body; called once, at the first use.
    """

    @staticmethod
    def traits(keys: Mapping[str, Any]) -> Traits:
        """Declare the base's density, and that the rest of the body requires detected joints."""
        base: Traits = keys["base"]
        needs = combined_requirements(
            {"base": base, "rest": component_traits(dataset=KEYPOINTS, assumptions=TRAJECTORY)}
        )
        needs["assumptions"] -= {FIXED_OTHER_JOINTS}
        return Traits(base.provides & {DENSITY}, needs, base.missing)

    def __init__(self, base: Prior, trajectory: Callable[[], Trajectory]) -> None:
        super().__init__(base, "time", ("time",), "s")
        self._fit, self.parameters = trajectory, base.parameters
        self._fitted = [i for i, name in enumerate(POSE_NAMES) if name not in base.parameters]

    @cached_property
    def trajectory(self) -> Trajectory:
        """The whole body's motion."""
        return self._fit()

    @property
    def capabilities(self) -> PriorCapabilities:
        """The base's density, and the trajectory's first pose."""
        return PriorCapabilities(density=self.density(), first_pose=lambda: self.trajectory.poses[0])

    def sample_initial(self, pose: FloatArray, n: int, rng: np.random.Generator) -> FloatArray:
        """Sample n initial states (n, D) around an initial pose (P,), at the trajectory's first time."""
        return np.concatenate([self.base.sample_initial(pose, n, rng), np.zeros((n, 1))], axis=1)

    def transition(self, dt_s: float) -> tuple[float, float, float]:
        """Return the coefficients of time_t = time_t−1 + dt_s, without noise."""
        return 1.0, dt_s, 0.0

    def pose(self, state: FloatArray) -> FloatArray:
        """Return the poses (N, P) of states (N, D)."""
        poses = self.base.pose(self.base_state(state)).copy()
        for i in self._fitted:
            poses[:, i] = np.interp(state[:, -1], self.trajectory.times_s, self.trajectory.poses[:, i])
        return poses
