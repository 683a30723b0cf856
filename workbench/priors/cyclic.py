"""A prior over cyclic motion: coefficients of a learned model, its phase and the phase's speed, and the root.

Papers A (section 6.2, eq. 14–17) and B (section 3): `θ(t) = μ(ψ_t) + Σ_k c_{t,k} v_k(ψ_t)`.
"""

from collections.abc import Mapping
from typing import Any

import numpy as np
import scipy

from workbench.body.skeleton import N_ROOT, POSE_NAMES
from workbench.core.capabilities import DENSITY, MOTION, SEPARABLE, Traits, offering
from workbench.core.keys import records_arguments
from workbench.core.prior import PriorCapabilities
from workbench.core.side_information import FIXED_TORSO_ORIENTATION
from workbench.core.state_space import StateSpace
from workbench.motion.models.activities import ActivityModel
from workbench.motion.models.walking import ANGLES, CHANNEL_NAMES, WalkingModel
from workbench.priors.density import REFERENCE_RATE_HZ, AllFree, apart, by_column, log_normal, smoothness
from workbench.utils.arrays import FloatArray
from workbench.utils.errors import InputError
from workbench.utils.kernel_cache import kernel
from workbench.utils.parallel import parallel_for

HEADING = POSE_NAMES.index("root_heading")
TABLE_PHASES = 256
TRANSITIONS = ("stationary", "A", "B")
START_COEFFICIENTS, START_PHASE = 0.3, 0.015  # deviations of the first states, λ and cycles
ANGLE_SIGMA_RAD = 0.1  # deviation of an angle of a starting pose from the model's
_ROWS = 256  # states that are worth a thread


@records_arguments
class Cyclic(AllFree):
    """The cyclic prior over states {c, ψ, ρ, τ, θ}, D = d + 8, of a learned WalkingModel.

    Noise is given per frame at 30 Hz and grows with the square root of the time between frames. sigma_coefficients:
    fraction of λ_k (A eq. 14). sigma_phase: cycles (A eq. 15). sigma_phase_speed: cycles/s (B). sigma_position: m,
    along world x, y, z (A eq. 16). sigma_rotation: rad, heading, pitch and roll (A eq. 17). start_*: standard
    deviations of the first states around the starting pose, in the same units; the speed of the phase starts from its
    learned distribution. penalty: what a fit lets change between frames at 14 Hz, by the fields of `Smoothness`.

    transition: "stationary", or what a paper writes, with the noise above:

        "A" (eq. 14–17)  c_t ~ N(c_t−1, (ελ)²)   μ_t ~ N(μ_t−1 + ρ, σ_μ²)   τ_t ~ N(T_t−1 [v Δt, 0, 0, 1]ᵀ, σ_τ²)
        "B" (section 3)  c, ρ, τ and θ random walks, no more   ψ_t = ψ_t−1 + ρ_t−1 + noise

    and θ_t ~ N(θ_t−1, σ_θ²). Under A ρ is the mean of the training cycles and no part of the state, D = d + 7 (eq. 15
    has no drift); B has learned no torso speed v. Raises InputError for another.

    Deviations of "stationary". Coefficients shrink towards zero so that they stay N(0, λ²): a pure random walk leaves
    the learned range in long clips. The root moves along its heading over the ground rather than along the torso's own
    axis, so that a torso that leans does not sink. Where the model has learned the root's sway
    (`walking.ROOT_CHANNELS`), {τ, θ} are of its even way, and the sway is added to it."""

    @staticmethod
    def traits(keys: Mapping[str, Any]) -> Traits:
        """Declare a density, a motion model, independent columns, and a torso that is held where it has no noise."""
        held = not np.any(keys.get("sigma_rotation", 1.0))
        return offering(DENSITY, MOTION, SEPARABLE, given=(FIXED_TORSO_ORIENTATION,) if held else ())

    def __init__(
        self, model: WalkingModel, *,
        sigma_coefficients: float = 0.05, sigma_phase: float = 0.009, sigma_phase_speed: float = 0.01,
        sigma_position: tuple[float, float, float] = (0.01, 0.01, 0.01),
        sigma_rotation: tuple[float, float, float] = (0.01, 0.005, 0.005),
        start_position: float = 0.01, start_rotation: float = 0.02, penalty: Mapping[str, float] | None = None,
        transition: str = "stationary",
    ) -> None:  # fmt: skip
        if transition not in TRANSITIONS:
            raise InputError(f"prior: transition must be one of {', '.join(TRANSITIONS)}, found {transition!r}")
        for name, given in (("sigma_position", sigma_position), ("sigma_rotation", sigma_rotation)):
            if len(given) != 3:
                raise InputError(f"prior: {name} must hold three numbers, found {len(given)}")
        self.model, self.transition = model, transition
        self.sways = model.mean.shape[1] > len(CHANNEL_NAMES)
        self.parameters = POSE_NAMES
        groups = cycle_groups(tuple(f"c{k + 1}" for k in range(len(model.scales))), "λ")
        if transition == "A":
            del groups["phase_speed"]
        self.space = StateSpace.of(groups)
        self._sigma = by_column(
            self.space, coefficients=sigma_coefficients, phase=sigma_phase, **self._of_speed(sigma_phase_speed),
            root_position=sigma_position, root_rotation=sigma_rotation,
        )  # fmt: skip
        self._start = by_column(
            self.space, coefficients=START_COEFFICIENTS, phase=START_PHASE, **self._of_speed(model.cycle_rate_hz[1]),
            root_position=start_position, root_rotation=np.where(np.array(sigma_rotation) > 0.0, start_rotation, 0.0),
        )  # fmt: skip
        self._sigma_coefficients = sigma_coefficients
        self._smoothness, self._motion = smoothness(penalty), _motion_model(model)
        curves = np.concatenate([model.mean[None], model.components * model.scales[:, None, None]])
        self._table = np.ascontiguousarray(scipy.signal.resample(curves, TABLE_PHASES, axis=1).transpose(1, 0, 2))
        self._speed = np.ascontiguousarray(self._table[:, :, :1])

    @property
    def capabilities(self) -> PriorCapabilities:
        """Its density, the learned cycle as a motion model and the penalty of a fit."""
        return PriorCapabilities(self, self._motion, self._smoothness, discrepancy=self.model.discrepancy)

    def sample_initial(self, pose: FloatArray, n: int, rng: np.random.Generator) -> FloatArray:
        """N states (N, D) around the state whose pose comes nearest to a starting pose (P,)."""
        state = self.nearest(pose) + self._start * rng.standard_normal((n, len(self.space)))
        state[:, self.space.slices["phase"]] %= 1.0
        return state

    def sample_transition(self, state: FloatArray, dt_s: float, rng: np.random.Generator) -> FloatArray:
        """One draw from p(state_t | state_t−1) for each of (N, D) states, `dt_s` seconds later."""
        moved = rng.standard_normal(state.shape)  # in place from here on: of many states a copy takes as long as a draw
        moved *= np.sqrt(dt_s * REFERENCE_RATE_HZ)
        moved *= self._sigma
        moved += state
        return self._drifted(state, moved, dt_s)

    def mean(self, state: FloatArray, dt_s: float) -> FloatArray:
        """Predict where states (N, D) are `dt_s` seconds later when the noise is zero, (N, D)."""
        return self._drifted(state, state.copy(), dt_s)

    def log_transition(self, previous: FloatArray, state: FloatArray, dt_s: float) -> FloatArray:
        """log p(state | previous), (...), of states (..., D) that broadcast; the phase by the shortest way round."""
        mean = self.mean(previous.reshape(-1, len(self.space)), dt_s).reshape(previous.shape)
        return log_normal(apart(self.space, mean, state), np.sqrt(dt_s * REFERENCE_RATE_HZ) * self._sigma)

    def _drifted(self, state: FloatArray, moved: FloatArray, dt_s: float) -> FloatArray:
        """`moved`, which is `state` with its noise, after the drift of `dt_s` seconds."""
        slices = self.space.slices
        if self.transition == "stationary":
            kept = np.sqrt(max(0.0, 1.0 - dt_s * REFERENCE_RATE_HZ * self._sigma_coefficients**2))
            moved[:, slices["coefficients"]] -= (1.0 - kept) * state[:, slices["coefficients"]]
        cycles_hz = state[:, slices["phase_speed"]] if "phase_speed" in slices else self.model.cycle_rate_hz[0]
        moved[:, slices["phase"]] = (moved[:, slices["phase"]] + dt_s * cycles_hz) % 1.0
        if self.transition != "B":
            moved[:, slices["root_position"]] += self._way(state, dt_s)
        return moved

    def _way(self, state: FloatArray, dt_s: float) -> FloatArray:
        """The root's way (N, 3), m, at the learned speed: along the heading, or under "A" along the torso's axis."""
        slices = self.space.slices
        speed = decode(self._speed, state[:, slices["coefficients"]], state[:, slices["phase"]][:, 0])[:, 0]
        heading, pitch = state[:, slices["root_rotation"]].T[:2]
        way = np.zeros((len(state), 3))
        way[:, 0], way[:, 1] = np.cos(heading), np.sin(heading)
        if self.transition == "A":
            way[:, :2] *= np.cos(pitch)[:, None]
            way[:, 2] = -np.sin(pitch)
        way *= (dt_s * speed)[:, None]
        return way

    def pose(self, state: FloatArray) -> FloatArray:
        """The poses (N, P) of states (N, D)."""
        slices = self.space.slices
        channels = decode(self._table, state[:, slices["coefficients"]], state[:, slices["phase"]][:, 0])
        poses = np.empty((len(state), N_ROOT + len(CHANNEL_NAMES[ANGLES])))
        poses[:, :N_ROOT] = root = state[:, slices["root_position"].start : slices["root_rotation"].stop]
        if self.sways:
            poses[:, :N_ROOT] += _turned(channels[:, len(CHANNEL_NAMES) :], root[:, HEADING])
        poses[:, N_ROOT:] = channels[:, ANGLES]
        return poses

    def nearest(self, pose: FloatArray) -> FloatArray:
        """Find the state (D,) with the learned phase speed whose angles come nearest to those of a pose (P,).

        It is at the `best_phase` of the table.
        """
        angles = self._table[:, :, ANGLES]
        missing = (pose[N_ROOT:] - angles[:, 0]) / ANGLE_SIGMA_RAD
        best, coefficients = best_phase(angles[:, 1:] / ANGLE_SIGMA_RAD, missing)
        root = pose[:N_ROOT].copy()
        if self.sways:
            sway = decode(self._table, coefficients[None], np.array([best / TABLE_PHASES]))
            sway = sway[:, len(CHANNEL_NAMES) :]
            root -= _turned(sway, pose[HEADING : HEADING + 1] - sway[:, 2])[0]
        return by_column(
            self.space, coefficients=coefficients, phase=best / TABLE_PHASES,
            **self._of_speed(self.model.cycle_rate_hz[0]), root_position=root[:3], root_rotation=root[3:],
        )  # fmt: skip

    def _of_speed(self, value: float) -> dict[str, float]:
        """The value of the phase's speed, where that is part of the state."""
        return {"phase_speed": value} if "phase_speed" in self.space.slices else {}


def cycle_groups(coefficients: tuple[str, ...], unit: str) -> dict[str, tuple[tuple[str, ...], str]]:
    """Name the columns that states of a cycle begin with, see `StateSpace.of`; unit: of the coefficients."""
    return {
        "coefficients": (coefficients, unit), "phase": (("phase",), "cycle"),
        "phase_speed": (("phase_speed",), "cycle/s"), "root_position": (POSE_NAMES[:3], "m"),
        "root_rotation": (POSE_NAMES[3:N_ROOT], "rad"),
    }  # fmt: skip


def best_phase(basis: FloatArray, missing: FloatArray) -> tuple[int, FloatArray]:
    """Find which of T phases explains angles best, and the coefficients (d,) there.

    At each the coefficients are those of a ridge regression of what is missing (T, C) from the mean on the components
    (T, d, C), with their N(0, 1) prior, both over an angle's deviation; the phase with the smallest cost wins.
    """
    normal = basis @ basis.transpose(0, 2, 1) + np.eye(basis.shape[1])
    coefficients = np.linalg.solve(normal, basis @ missing[:, :, None])[:, :, 0]
    residuals = missing - np.einsum("tk,tkc->tc", coefficients, basis)
    best = int(np.argmin((residuals**2).sum(axis=1) + (coefficients**2).sum(axis=1)))
    return best, coefficients[best]


def _motion_model(model: WalkingModel) -> ActivityModel:
    """A cyclic model as a motion model of one activity, with cycles two deviations slower and faster as examples.

    The channels of the root, such as the sway, are left out: a fit has a root of its own.
    """
    mean_hz, deviation_hz = model.cycle_rate_hz
    return ActivityModel(
        angles=CHANNEL_NAMES[ANGLES], mean=model.mean[:, ANGLES], components=model.components[:, :, ANGLES],
        scales=model.scales, explained=np.array([model.explained]), scores=np.zeros((3, len(model.scales))),
        activities=("cycle",) * 3, sources=("",) * 3,
        cycle_rate_hz=mean_hz + deviation_hz * np.array([-2.0, 0.0, 2.0]), discrepancy=model.discrepancy,
    )  # fmt: skip


def _turned(sway: FloatArray, heading: FloatArray) -> FloatArray:
    """Turn ROOT_CHANNELS (N, 5) by headings (N,) into what they add to the root's six numbers (N, 6) in the world."""
    aside, others = sway[:, :1], sway[:, 1:]
    return np.hstack([-np.sin(heading)[:, None] * aside, np.cos(heading)[:, None] * aside, others])


def decode(table: FloatArray, coefficients: FloatArray, phase: FloatArray) -> FloatArray:
    """Channels (N, C) at phases (N,) for coefficients (N, d) in units of λ: μ(ψ) + Σ_k c_k v_k(ψ) (B, section 3).

    table: (M, 1 + d, C) the mean and the scaled components at M equidistant phases, interpolated linearly. Written as
    a kernel rather than as matrix products so that the result does not depend on the number of BLAS threads.
    """
    channels = np.empty((len(phase), table.shape[2]))
    arguments = table, np.ascontiguousarray(coefficients), np.ascontiguousarray(phase), channels
    parallel_for(lambda first, last: _decode(first, last, *arguments), len(channels), _ROWS)
    return channels


@kernel()
def _decode(first: int, last: int, table: Any, coefficients: Any, phase: Any, channels: Any) -> None:
    n_phases, n_curves, n_channels = table.shape
    for n in range(first, last):
        place = (phase[n] % 1.0) * n_phases
        floor = int(np.floor(place))
        part = place - floor
        low, high = table[floor % n_phases], table[(floor + 1) % n_phases]
        for c in range(n_channels):
            channels[n, c] = (1.0 - part) * low[0, c] + part * high[0, c]
        for k in range(1, n_curves):
            a, b = (1.0 - part) * coefficients[n, k - 1], part * coefficients[n, k - 1]
            for c in range(n_channels):
                channels[n, c] += a * low[k, c] + b * high[k, c]
