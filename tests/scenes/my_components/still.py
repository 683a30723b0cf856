import numpy as np

from workbench.body.skeleton import POSE_NAMES
from workbench.core.prior import PriorCapabilities
from workbench.core.state_space import StateSpace


class Still:
    """Every parameter stays where it is, give or take sigma a frame at 30 Hz."""

    def __init__(self, *, sigma: float = 0.02) -> None:
        self.sigma, self.parameters, self.capabilities = sigma, POSE_NAMES, PriorCapabilities()
        self.space = StateSpace.of({"pose": (POSE_NAMES, "rad")})

    def sample_initial(self, pose, n, rng):
        return pose + self.sigma * rng.standard_normal((n, len(pose)))

    def sample_transition(self, state, dt_s, rng):
        return state + self.sigma * np.sqrt(30 * dt_s) * rng.standard_normal(state.shape)

    def pose(self, state):
        return state
