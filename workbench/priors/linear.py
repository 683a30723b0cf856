"""Linear-Gaussian prior, regressed on all recorded motions, with correlated noise."""

from dataclasses import KW_ONLY, dataclass
from functools import cached_property

import numpy as np

from workbench.body.skeleton import N_ROOT, POSE_NAMES
from workbench.core.capabilities import DENSITY, component_traits
from workbench.core.checks import POSITIVE, check
from workbench.core.prior import RECORDED_SMOOTHNESS, PriorCapabilities
from workbench.core.state_space import StateSpace
from workbench.motion.models.linear_motion import N_POSE, POSTURE, LinearMotion, integrated, velocities
from workbench.priors.density import whole_frames
from workbench.utils.arrays import FloatArray, IntArray
from workbench.utils.errors import InputError

INITIAL_POSITION_STD, INITIAL_ANGLE_STD = 0.03, 0.05  # standard deviations of the initial poses, m and rad
_ROOT_VELOCITIES = ("ahead", "aside", "up", "turn")


@dataclass(frozen=True, eq=False)
class Linear:
    """States {pose, velocity} of a linear-Gaussian model, see `LinearMotion`:

        v_t = gain [posture_t−1, v_t−1] + offset + N(0, noise_scale² covariance),   pose_t = pose_t−1 integrated by v_t

    Two poses determine the velocity between them: the pose's columns are free, the velocities depend on them.
    noise_scale : factor on the standard deviations of the training residuals. Deviation: no joint limits. Raises
    InputError if noise_scale is not positive.
    """

    traits = component_traits(DENSITY)

    model: LinearMotion
    _: KW_ONLY
    noise_scale: float = 1.0

    def __post_init__(self) -> None:
        check("prior", self, noise_scale=POSITIVE)

    @property
    def parameters(self) -> tuple[str, ...]:
        """All parameters of the pose."""
        return POSE_NAMES

    @cached_property
    def space(self) -> StateSpace:
        """Columns of the pose and of its velocity; the root's velocity is in the heading frame."""
        names = (*_ROOT_VELOCITIES, *(f"{name}_velocity" for name in POSE_NAMES[len(_ROOT_VELOCITIES) :]))
        units = ("m/s",) * 3 + ("rad/s",) * (N_POSE - 3)
        return StateSpace.of({
            "root_position": (POSE_NAMES[:3], "m"), "root_rotation": (POSE_NAMES[3:N_ROOT], "rad"),
            "angles": (POSE_NAMES[N_ROOT:], "rad"),
        }).appended("velocity", names, units)  # fmt: skip

    @property
    def capabilities(self) -> PriorCapabilities:
        """The density, the pose prior and the penalty of a fit."""
        return PriorCapabilities(density=self, smoothness=RECORDED_SMOOTHNESS, pose_prior=self.model.pose_prior)

    @property
    def free(self) -> IntArray:
        """The pose's columns (P,)."""
        return np.arange(N_POSE)

    def sample_initial(self, pose: FloatArray, n: int, rng: np.random.Generator) -> FloatArray:
        """Sample n initial states (n, 50) around an initial pose (P,), with velocities given the posture."""
        model, covariance = self.model, np.zeros((2 * N_POSE, 2 * N_POSE))
        mean = np.concatenate([pose, model.initial_gain @ pose[POSTURE] + model.initial_offset])
        std = np.full(N_POSE, INITIAL_ANGLE_STD)
        std[:3] = INITIAL_POSITION_STD
        covariance[:N_POSE, :N_POSE] = np.diag(std**2)
        covariance[N_POSE:, N_POSE:] = model.initial_covariance
        return mean + rng.standard_normal((n, 2 * N_POSE)) @ np.linalg.cholesky(covariance).T

    def sample_transition(self, state: FloatArray, dt_s: float, rng: np.random.Generator) -> FloatArray:
        """Sample from p(state_t | state_t−1), (N, D), once for each state (N, D), `dt_s` seconds later.

        Raises InputError if dt_s is not a whole number of the model's frames (to 5 % of one).
        """
        for _ in range(self._frames_in(dt_s)):
            velocity = self._predicted_velocity(state) + rng.standard_normal((len(state), N_POSE)) @ self._root.T
            state = np.concatenate([integrated(state[:, :N_POSE], velocity, self.model.rate_hz), velocity], axis=1)
        return state

    def pose(self, state: FloatArray) -> FloatArray:
        """Return the poses (N, P) of states (N, D)."""
        return np.ascontiguousarray(state[:, :N_POSE])

    def mean(self, state: FloatArray, dt_s: float) -> FloatArray:
        """Return the noise-free prediction (N, D) of states (N, D) after `dt_s` seconds."""
        for _ in range(self._frames_in(dt_s)):
            velocity = self._predicted_velocity(state)
            state = np.concatenate([integrated(state[:, :N_POSE], velocity, self.model.rate_hz), velocity], axis=1)
        return state

    def log_transition(self, previous: FloatArray, state: FloatArray, dt_s: float) -> FloatArray:
        """Return log p(pose | previous), (...), of states (..., D) that broadcast."""
        self._one_frame(dt_s)
        previous, state = np.broadcast_arrays(previous, state)
        velocity = velocities(previous[..., :N_POSE], state[..., :N_POSE], self.model.rate_hz)
        whitened = (velocity - self._predicted_velocity(previous)) @ np.linalg.inv(self._root).T
        scale = np.log(np.sqrt(2.0 * np.pi) * np.diag(self._root) / self.model.rate_hz).sum()
        return np.asarray(-0.5 * (whitened**2).sum(axis=-1) - scale)

    def sample_dependent(
        self, previous: FloatArray, state: FloatArray, dt_s: float, rng: np.random.Generator
    ) -> FloatArray:
        """Return states (N, D) with the velocities between the previous poses and theirs."""
        velocity = velocities(previous[:, :N_POSE], state[:, :N_POSE], self.model.rate_hz)
        return np.concatenate([state[:, :N_POSE], velocity], axis=1)

    @cached_property
    def _root(self) -> FloatArray:
        """Cholesky factor (25, 25) of the velocities' noise covariance."""
        return np.asarray(self.noise_scale * np.linalg.cholesky(self.model.covariance), dtype=np.float64)

    def _predicted_velocity(self, state: FloatArray) -> FloatArray:
        inputs = np.concatenate([state[..., POSTURE], state[..., N_POSE:]], axis=-1)
        return np.asarray(np.einsum("vf,...f->...v", self.model.gain, inputs) + self.model.offset)

    def _frames_in(self, dt_s: float) -> int:
        """Return the number of the model's frames in dt_s seconds; raises InputError unless it is whole."""
        if (frames := whole_frames(dt_s, self.model.rate_hz)) is None:
            raise InputError(
                f"prior: a frame interval of {dt_s:.4g} s is not a whole number of frames of a linear prior learned at "
                f"{self.model.rate_hz:g} Hz; learn it at the video's rate (prior.rate_hz)"
            )
        return frames

    def _one_frame(self, dt_s: float) -> None:
        if self._frames_in(dt_s) != 1:
            raise InputError(
                f"prior: the density of a linear prior covers one frame, 1/{self.model.rate_hz:g} s, "
                f"found an interval of {dt_s:.4g} s"
            )
