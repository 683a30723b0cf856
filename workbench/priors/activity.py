"""Prior over walking, running and intermediate motions: coefficients and phase of one learned motion model."""

from collections.abc import Mapping
from typing import Any

import numpy as np

from workbench.body.skeleton import N_ROOT
from workbench.core.capabilities import ACTIVITY, ALL_JOINTS, DENSITY, MOTION, SEPARABLE, Traits, component_traits
from workbench.core.prior import PriorCapabilities
from workbench.core.state_space import StateSpace
from workbench.motion.models.activities import ActivityModel
from workbench.priors import density
from workbench.priors.cyclic import ANGLE_SIGMA_RAD, best_phase, cycle_groups
from workbench.priors.density import REFERENCE_RATE_HZ, AllColumnsFree, by_column, log_normal, smoothness
from workbench.utils.arrays import FloatArray

N_PHASES = 64
INITIAL_COEFFICIENT_STD, INITIAL_PHASE_STD, INITIAL_POSITION_STD, INITIAL_ROTATION_STD = 0.5, 0.03, 0.02, 0.03
"""Of the initial states around the initial pose: standard deviations of a coefficient, cycles, m and rad."""
INITIAL_VELOCITY_STD = 2.0  # m/s along the heading
MIN_SIGMA = 1e-9  # standard deviation of columns without noise, so that their density exists


class Activity(AllColumnsFree):
    """A prior over states {α, μ, speed of μ, root, root velocity} of paper D's motion model, D = d + 11.

    Paper D fits the model by least squares. As a temporal prior it allows a comparison of a particle filter with that
    fit on the same data. Coefficients and phase follow Gaussian random walks as in paper B, section 3. The root, which
    the model does not cover, moves with a velocity that is a random walk too. Coefficients shrink towards zero so that
    N(0, 1) is stationary. The initial phase speed is that of a random training example; the initial root velocity is
    N(0, INITIAL_VELOCITY_STD²) along the heading, and a tenth of that sideways and upwards. Poses are the person's, or
    those of the full skeleton that the model was learned on.

    Parameters
    ----------
    model : the motion model.
    sigma_coefficients, sigma_phase, sigma_phase_speed, sigma_position, sigma_rotation, sigma_velocity : noise per frame
        at 30 Hz, which grows with the square root of the time step: standard deviations of a coefficient over the
        examples, cycles, cycles/s, m, rad (heading, pitch, roll) and m/s.
    penalty : of a fit on changes between frames, by the fields of `Smoothness`.
    """

    @staticmethod
    def traits(keys: Mapping[str, Any]) -> Traits:
        """Declare a motion model of activities, of the person or of every joint; the latter requires such a dataset."""
        provided, skeleton = (DENSITY, MOTION, ACTIVITY, SEPARABLE), keys.get("skeleton", "person")
        joints = () if skeleton == "person" else (ALL_JOINTS,)
        return component_traits(*provided, *joints, **({"dataset": ALL_JOINTS} if skeleton == "full" else {}))

    def __init__(
        self, model: ActivityModel, *,
        sigma_coefficients: float = 0.2, sigma_phase: float = 0.02, sigma_phase_speed: float = 0.02,
        sigma_position: float = 0.01, sigma_rotation: tuple[float, float, float] = (0.01, 0.005, 0.005),
        sigma_velocity: float = 0.1, penalty: Mapping[str, float] | None = None,
    ) -> None:  # fmt: skip
        self.model, names = model, model.pose_names
        self.parameters = tuple(name for name in names if name in (*names[:N_ROOT], *model.angles))
        self.space = StateSpace.of({
            **cycle_groups(tuple(f"a{k + 1}" for k in range(len(model.scales))), "σ"),
            "root_velocity": (tuple(f"{name}_velocity" for name in names[:3]), "m/s"),
            "fixed": (tuple(name for name in names[N_ROOT:] if name not in model.angles), "rad"),
        })  # fmt: skip
        self._angles = [names.index(name) for name in model.angles]
        self._fixed = [names.index(name) for name in self.space.names[self.space.slices["fixed"]]]
        self._sigma = by_column(
            self.space, coefficients=sigma_coefficients, phase=sigma_phase, phase_speed=sigma_phase_speed,
            root_position=sigma_position, root_rotation=sigma_rotation, root_velocity=sigma_velocity,
        )  # fmt: skip
        self._initial_std = by_column(
            self.space, coefficients=INITIAL_COEFFICIENT_STD, phase=INITIAL_PHASE_STD,
            root_position=INITIAL_POSITION_STD, root_rotation=INITIAL_ROTATION_STD,
        )  # fmt: skip
        self._shrinkage = 1.0 - sigma_coefficients**2
        self._smoothness = smoothness(penalty)

    @property
    def capabilities(self) -> PriorCapabilities:
        """The density, the motion model and the penalty of a fit."""
        return PriorCapabilities(self, self.model, self._smoothness, discrepancy=self.model.discrepancy)

    def sample_initial(self, pose: FloatArray, n: int, rng: np.random.Generator) -> FloatArray:
        """Sample n initial states (n, D) around the state that is nearest to an initial pose (P,)."""
        slices = self.space.slices
        state = self.nearest(pose) + self._initial_std * rng.standard_normal((n, len(self.space)))
        state[:, slices["phase"]] %= 1.0
        state[:, slices["phase_speed"]] = rng.choice(self.model.cycle_rate_hz, n)[:, None]
        along, sideways, up = INITIAL_VELOCITY_STD * np.array([1.0, 0.1, 0.1])[:, None] * rng.standard_normal((3, n))
        heading = state[:, slices["root_rotation"].start]
        c, s = np.cos(heading), np.sin(heading)
        state[:, slices["root_velocity"]] = np.column_stack([c * along - s * sideways, s * along + c * sideways, up])
        return state

    def sample_transition(self, state: FloatArray, dt_s: float, rng: np.random.Generator) -> FloatArray:
        """Sample from p(state_t | state_t−1), (N, D), once for each state (N, D), `dt_s` seconds later."""
        noise = np.sqrt(dt_s * REFERENCE_RATE_HZ) * self._sigma * rng.standard_normal(state.shape)
        moved: FloatArray = self._predicted(state, dt_s) + noise
        moved[:, self.space.slices["phase"]] %= 1.0
        return moved

    def mean(self, state: FloatArray, dt_s: float) -> FloatArray:
        """Return the noise-free prediction (N, D) of states (N, D) after `dt_s` seconds."""
        moved = self._predicted(state, dt_s)
        moved[:, self.space.slices["phase"]] %= 1.0
        return moved

    def log_transition(self, previous: FloatArray, state: FloatArray, dt_s: float) -> FloatArray:
        """Return log p(state | previous), (...), of states (..., D) that broadcast; phase differences are wrapped."""
        mean = self.mean(previous.reshape(-1, len(self.space)), dt_s).reshape(previous.shape)
        return log_normal(
            density.state_difference(self.space, mean, state), np.sqrt(dt_s * REFERENCE_RATE_HZ) * self._sigma
        )

    def _predicted(self, state: FloatArray, dt_s: float) -> FloatArray:
        slices = self.space.slices
        moved: FloatArray = state.copy()
        moved[:, slices["coefficients"]] *= np.sqrt(max(0.0, self._shrinkage) ** (dt_s * REFERENCE_RATE_HZ))
        moved[:, slices["phase"]] += dt_s * state[:, slices["phase_speed"]]
        moved[:, slices["root_position"]] += dt_s * state[:, slices["root_velocity"]]
        return moved

    def predicted(self, state: FloatArray, dt_s: float) -> tuple[FloatArray, FloatArray]:
        """Return means (N, D') and standard deviations (D',) of p(s_t | state), s_t being the columns `driven`.

        dt_s : seconds from the states (N, D) to s_t. The phase is not wrapped.
        """
        sigma = np.sqrt(dt_s * REFERENCE_RATE_HZ) * self._sigma[self.driven]
        return self._predicted(state, dt_s)[:, self.driven], np.maximum(sigma, MIN_SIGMA)

    @property
    def driven(self) -> list[int]:
        """Columns of α, μ and the root, in this order: those that determine the pose."""
        slices = self.space.slices
        names = ("coefficients", "phase", "root_position", "root_rotation")
        return [column for name in names for column in range(slices[name].start, slices[name].stop)]

    def pose(self, state: FloatArray) -> FloatArray:
        """Return the poses (N, P) of states (N, D)."""
        slices = self.space.slices
        poses = np.empty((len(state), len(self.model.pose_names)))
        poses[:, :3], poses[:, 3:N_ROOT] = state[:, slices["root_position"]], state[:, slices["root_rotation"]]
        poses[:, self._fixed] = state[:, slices["fixed"]]
        poses[:, self._angles] = self.model.angles_at(state[:, slices["coefficients"]], state[:, slices["phase"]][:, 0])
        return poses

    def nearest(self, pose: FloatArray) -> FloatArray:
        """Return the state (D,) at rest with the angles nearest to a pose (P,), at the `best_phase` of N_PHASES."""
        phases = np.arange(N_PHASES) / N_PHASES
        zero = np.zeros((N_PHASES, len(self.model.scales)))
        basis = self.model.jacobian_at(zero, phases)[0] / ANGLE_SIGMA_RAD  # (N_PHASES, C, d)
        residuals = (pose[self._angles] - self.model.angles_at(zero, phases)) / ANGLE_SIGMA_RAD
        best, alpha = best_phase(basis.transpose(0, 2, 1), residuals)
        return by_column(
            self.space, coefficients=alpha, phase=phases[best], root_position=pose[:3], root_rotation=pose[3:N_ROOT],
            fixed=pose[self._fixed],
        )  # fmt: skip
