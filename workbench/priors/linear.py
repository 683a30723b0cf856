"""A linear prior: how poses go on, regressed on all recorded motions, with Gaussian noise that angles share."""

from dataclasses import KW_ONLY, dataclass
from functools import cached_property

import numpy as np

from workbench.body.skeleton import N_ROOT, POSE_NAMES
from workbench.core.capabilities import DENSITY, GAUSSIAN, offering
from workbench.core.checks import POSITIVE, check
from workbench.core.prior import RECORDED, PriorCapabilities
from workbench.core.state_space import StateSpace
from workbench.motion.models.linear_motion import N_POSE, POSTURE, LinearMotion, moved, velocities
from workbench.priors.density import whole_frames
from workbench.utils.arrays import FloatArray, IntArray
from workbench.utils.errors import InputError

START_POSITION, START_ANGLES = 0.03, 0.05  # deviations of the first poses, m and rad
_SPEEDS = ("ahead", "aside", "up", "turn")


@dataclass(frozen=True, eq=False)
class Linear:
    """States {pose, velocity} of a linear-Gaussian model, see `LinearMotion`:

        v_t = gain [posture_t−1, v_t−1] + offset + N(0, noise² covariance),   pose_t = pose_t−1 led on by v_t

    The pose determines the velocity that led to it: the pose's columns are free and velocities follow. noise: factor of
    the deviations that recorded motions leave. Deviation: nothing keeps the angles inside the skeleton's limits but the
    data. Raises InputError for a noise that is not positive.
    """

    traits = offering(DENSITY, GAUSSIAN)

    model: LinearMotion
    _: KW_ONLY
    noise_scale: float = 1.0

    def __post_init__(self) -> None:
        check("prior", self, noise_scale=POSITIVE)

    @property
    def parameters(self) -> tuple[str, ...]:
        """All of the pose's."""
        return POSE_NAMES

    @cached_property
    def space(self) -> StateSpace:
        """Name the pose's columns and those of its velocity, of which the root's are as the person heads."""
        names = (*_SPEEDS, *(f"{name}_velocity" for name in POSE_NAMES[len(_SPEEDS) :]))
        units = ("m/s",) * 3 + ("rad/s",) * (N_POSE - 3)
        return StateSpace.of({
            "root_position": (POSE_NAMES[:3], "m"), "root_rotation": (POSE_NAMES[3:N_ROOT], "rad"),
            "angles": (POSE_NAMES[N_ROOT:], "rad"),
        }).appended("velocity", names, units)  # fmt: skip

    @property
    def capabilities(self) -> PriorCapabilities:
        """Its density, that of postures, and the penalty of a fit."""
        return PriorCapabilities(density=self, smoothness=RECORDED, postures=self.model.postures)

    @property
    def free(self) -> IntArray:
        """The pose's columns."""
        return np.arange(N_POSE)

    def sample_initial(self, pose: FloatArray, n: int, rng: np.random.Generator) -> FloatArray:
        """Draw N states (N, 50) around a starting pose (P,), with velocities as people in such postures have."""
        mean, covariance = self.start_moments(pose)
        return mean + rng.standard_normal((n, 2 * N_POSE)) @ np.linalg.cholesky(covariance).T

    def start_moments(self, pose: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return mean (50,) and covariance (50, 50) of what `sample_initial` draws."""
        model, covariance = self.model, np.zeros((2 * N_POSE, 2 * N_POSE))
        speeds = model.start_gain @ pose[POSTURE] + model.start_offset
        spread = np.full(N_POSE, START_ANGLES)
        spread[:3] = START_POSITION
        covariance[:N_POSE, :N_POSE] = np.diag(spread**2)
        covariance[N_POSE:, N_POSE:] = model.start_covariance
        return np.concatenate([pose, speeds]), covariance

    def sample_transition(self, state: FloatArray, dt_s: float, rng: np.random.Generator) -> FloatArray:
        """Draw once from p(state_t | state_t−1) for each of (N, D) states, `dt_s` seconds later.

        Raises InputError when dt_s is not a whole number of the model's frames (to 5 % of one).
        """
        for _ in range(self._frames_in(dt_s)):
            drawn = self._speeds(state) + rng.standard_normal((len(state), N_POSE)) @ self._root.T
            state = np.concatenate([moved(state[:, :N_POSE], drawn, self.model.rate_hz), drawn], axis=1)
        return state

    def pose(self, state: FloatArray) -> FloatArray:
        """Return the poses (N, P) of states (N, D)."""
        return np.ascontiguousarray(state[:, :N_POSE])

    def mean(self, state: FloatArray, dt_s: float) -> FloatArray:
        """Predict where states (N, D) are `dt_s` seconds later when the noise is zero."""
        for _ in range(self._frames_in(dt_s)):
            speeds = self._speeds(state)
            state = np.concatenate([moved(state[:, :N_POSE], speeds, self.model.rate_hz), speeds], axis=1)
        return state

    def noise_covariance(self, state: FloatArray, dt_s: float) -> FloatArray:
        """Return the covariance (D, D) of what is drawn about the mean of one state (D,)."""
        self._one_frame(dt_s)
        lead = np.eye(N_POSE) / self.model.rate_hz
        c, s = np.cos(state[3]), np.sin(state[3])
        lead[:2, :2] = np.array([[c, -s], [s, c]]) / self.model.rate_hz
        both = np.concatenate([lead, np.eye(N_POSE)]) @ self._root
        return both @ both.T

    def log_transition(self, previous: FloatArray, state: FloatArray, dt_s: float) -> FloatArray:
        """Return log p(pose | previous), (...), of states (..., D) that broadcast."""
        self._one_frame(dt_s)
        previous, state = np.broadcast_arrays(previous, state)
        drawn = velocities(previous[..., :N_POSE], state[..., :N_POSE], self.model.rate_hz)
        white = (drawn - self._speeds(previous)) @ np.linalg.inv(self._root).T
        scale = np.log(np.sqrt(2.0 * np.pi) * np.diag(self._root) / self.model.rate_hz).sum()
        return np.asarray(-0.5 * (white**2).sum(axis=-1) - scale)

    def sample_dependent(
        self, previous: FloatArray, state: FloatArray, dt_s: float, rng: np.random.Generator
    ) -> FloatArray:
        """Return states (N, D) with the velocities that led to their poses."""
        speeds = velocities(previous[:, :N_POSE], state[:, :N_POSE], self.model.rate_hz)
        return np.concatenate([state[:, :N_POSE], speeds], axis=1)

    @cached_property
    def _root(self) -> FloatArray:
        """The Cholesky factor (25, 25) of the velocities' noise."""
        return np.asarray(self.noise_scale * np.linalg.cholesky(self.model.covariance), dtype=np.float64)

    def _speeds(self, state: FloatArray) -> FloatArray:
        known = np.concatenate([state[..., POSTURE], state[..., N_POSE:]], axis=-1)
        return np.asarray(np.einsum("vf,...f->...v", self.model.gain, known) + self.model.offset)

    def _frames_in(self, dt_s: float) -> int:
        """Count the model's frames in dt_s seconds; raises InputError unless it is a whole number."""
        if (frames := whole_frames(dt_s, self.model.rate_hz)) is None:
            raise InputError(
                f"prior: frames {dt_s:.4g} s apart are not a whole number of those of a linear prior learned at "
                f"{self.model.rate_hz:g} Hz; learn it at the video's rate (prior.rate_hz)"
            )
        return frames

    def _one_frame(self, dt_s: float) -> None:
        if self._frames_in(dt_s) != 1:
            raise InputError(
                f"prior: the density of a linear prior is that of one frame, 1/{self.model.rate_hz:g} s, "
                f"found {dt_s:.4g} s"
            )
