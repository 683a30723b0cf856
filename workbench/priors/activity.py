"""A prior over walking, running and what lies between them: coefficients of one learned motion model, and its phase."""

from collections.abc import Mapping
from typing import Any

import numpy as np

from workbench.body.skeleton import N_ROOT
from workbench.core.capabilities import ACTIVITY, ALL_JOINTS, DENSITY, MOTION, SEPARABLE, Traits, component_traits
from workbench.core.keys import records_arguments
from workbench.core.prior import PriorCapabilities
from workbench.core.state_space import StateSpace
from workbench.motion.models.activities import ActivityModel
from workbench.priors.cyclic import ANGLE_SIGMA_RAD, best_phase, cycle_groups
from workbench.priors.density import REFERENCE_RATE_HZ, AllFree, apart, by_column, log_normal, smoothness
from workbench.utils.arrays import FloatArray

N_PHASES = 64
START_COEFFICIENTS, START_PHASE, START_POSITION, START_ROTATION, START_VELOCITY = 0.5, 0.03, 0.02, 0.03, 2.0
"""Deviations of the first states around the starting pose: σ, cycles, m, rad and m/s along the heading."""
LEAST_SIGMA = 1e-9  # deviation of what has no noise, so that its density exists


@records_arguments
class Activity(AllFree):
    """A prior over states {α, μ, speed of μ, root, root's velocity} of paper D's motion model, D = d + 11.

    Paper D fits such a model by least squares; here it is a temporal prior, so that a particle filter can be compared
    with that fit on the same data. Gaussian random walks as in paper B, section 3. What the model does not say, the
    root, moves with a velocity of its own, which is a random walk too.

    Noise is given per frame at 30 Hz and grows with the square root of the time between frames. sigma_coefficients: in
    standard deviations of a coefficient over the examples; they shrink towards zero so that N(0, 1) stays stationary.
    sigma_phase: cycles. sigma_phase_speed: cycles/s. sigma_position: m. sigma_rotation: rad, heading, pitch and roll.
    sigma_velocity: m/s. The phase starts with the speed of an example drawn at random, the root with a velocity of N(0,
    START_VELOCITY²) along its heading, and a tenth of that sideways and upwards. penalty: what a fit lets change, by
    the fields of `Smoothness`.

    Poses are the person's, or those of the full skeleton that the model was learned on.
    """

    @staticmethod
    def traits(keys: Mapping[str, Any]) -> Traits:
        """Declare a motion model of activities, of the person or of every joint, which the dataset must then show."""
        own, skeleton = (DENSITY, MOTION, ACTIVITY, SEPARABLE), keys.get("skeleton", "person")
        joints = () if skeleton == "person" else (ALL_JOINTS,)
        return component_traits(*own, *joints, **({"dataset": ALL_JOINTS} if skeleton == "full" else {}))

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
            "held": (tuple(name for name in names[N_ROOT:] if name not in model.angles), "rad"),
        })  # fmt: skip
        self._angles = [names.index(name) for name in model.angles]
        self._held = [names.index(name) for name in self.space.names[self.space.slices["held"]]]
        self._sigma = by_column(
            self.space, coefficients=sigma_coefficients, phase=sigma_phase, phase_speed=sigma_phase_speed,
            root_position=sigma_position, root_rotation=sigma_rotation, root_velocity=sigma_velocity,
        )  # fmt: skip
        self._start = by_column(
            self.space, coefficients=START_COEFFICIENTS, phase=START_PHASE, root_position=START_POSITION,
            root_rotation=START_ROTATION,
        )  # fmt: skip
        self._kept = 1.0 - sigma_coefficients**2
        self._smoothness = smoothness(penalty)

    @property
    def capabilities(self) -> PriorCapabilities:
        """Its density, the motion model and the penalty of a fit."""
        return PriorCapabilities(self, self.model, self._smoothness, discrepancy=self.model.discrepancy)

    def sample_initial(self, pose: FloatArray, n: int, rng: np.random.Generator) -> FloatArray:
        """N states (N, D) around the one whose pose comes nearest to a starting pose (P,)."""
        slices = self.space.slices
        state = self.nearest(pose) + self._start * rng.standard_normal((n, len(self.space)))
        state[:, slices["phase"]] %= 1.0
        state[:, slices["phase_speed"]] = rng.choice(self.model.cycle_rate_hz, n)[:, None]
        along, sideways, up = START_VELOCITY * np.array([1.0, 0.1, 0.1])[:, None] * rng.standard_normal((3, n))
        heading = state[:, slices["root_rotation"].start]
        c, s = np.cos(heading), np.sin(heading)
        state[:, slices["root_velocity"]] = np.column_stack([c * along - s * sideways, s * along + c * sideways, up])
        return state

    def sample_transition(self, state: FloatArray, dt_s: float, rng: np.random.Generator) -> FloatArray:
        """One draw from p(state_t | state_t−1) for each of (N, D) states, `dt_s` seconds later."""
        noise = np.sqrt(dt_s * REFERENCE_RATE_HZ) * self._sigma * rng.standard_normal(state.shape)
        moved: FloatArray = self._predicted(state, dt_s) + noise
        moved[:, self.space.slices["phase"]] %= 1.0
        return moved

    def mean(self, state: FloatArray, dt_s: float) -> FloatArray:
        """Predict where states (N, D) are `dt_s` seconds later when the noise is zero, (N, D)."""
        moved = self._predicted(state, dt_s)
        moved[:, self.space.slices["phase"]] %= 1.0
        return moved

    def log_transition(self, previous: FloatArray, state: FloatArray, dt_s: float) -> FloatArray:
        """log p(state | previous), (...), of states (..., D) that broadcast; the phase by the shortest way round."""
        mean = self.mean(previous.reshape(-1, len(self.space)), dt_s).reshape(previous.shape)
        return log_normal(apart(self.space, mean, state), np.sqrt(dt_s * REFERENCE_RATE_HZ) * self._sigma)

    def _predicted(self, state: FloatArray, dt_s: float) -> FloatArray:
        slices = self.space.slices
        moved: FloatArray = state.copy()
        moved[:, slices["coefficients"]] *= np.sqrt(max(0.0, self._kept) ** (dt_s * REFERENCE_RATE_HZ))
        moved[:, slices["phase"]] += dt_s * state[:, slices["phase_speed"]]
        moved[:, slices["root_position"]] += dt_s * state[:, slices["root_velocity"]]
        return moved

    def predicted(self, state: FloatArray, dt_s: float) -> tuple[FloatArray, FloatArray]:
        """Means (N, D') and deviations (D',) of the Gaussian p(s_t | state), s_t being the columns `driven`.

        dt_s: seconds from the states (N, D) to s_t. The phase is counted on, without wrapping.
        """
        sigma = np.sqrt(dt_s * REFERENCE_RATE_HZ) * self._sigma[self.driven]
        return self._predicted(state, dt_s)[:, self.driven], np.maximum(sigma, LEAST_SIGMA)

    @property
    def driven(self) -> list[int]:
        """The columns of α, μ and the root, in this order, which a pose depends on."""
        slices = self.space.slices
        names = ("coefficients", "phase", "root_position", "root_rotation")
        return [column for name in names for column in range(slices[name].start, slices[name].stop)]

    def pose(self, state: FloatArray) -> FloatArray:
        """The poses (N, P) of states (N, D)."""
        slices = self.space.slices
        poses = np.empty((len(state), len(self.model.pose_names)))
        poses[:, :3], poses[:, 3:N_ROOT] = state[:, slices["root_position"]], state[:, slices["root_rotation"]]
        poses[:, self._held] = state[:, slices["held"]]
        poses[:, self._angles] = self.model.angles_at(state[:, slices["coefficients"]], state[:, slices["phase"]][:, 0])
        return poses

    def nearest(self, pose: FloatArray) -> FloatArray:
        """Find the state (D,) at rest whose angles come nearest to a pose's (P,), the `best_phase` of N_PHASES."""
        phases = np.arange(N_PHASES) / N_PHASES
        none = np.zeros((N_PHASES, len(self.model.scales)))
        basis = self.model.jacobian_at(none, phases)[0] / ANGLE_SIGMA_RAD  # (N_PHASES, C, d)
        missing = (pose[self._angles] - self.model.angles_at(none, phases)) / ANGLE_SIGMA_RAD
        best, alpha = best_phase(basis.transpose(0, 2, 1), missing)
        return by_column(
            self.space, coefficients=alpha, phase=phases[best], root_position=pose[:3], root_rotation=pose[3:N_ROOT],
            held=pose[self._held],
        )  # fmt: skip
