"""Prior over cyclic motion: coefficients of a learned model, phase, phase speed, and root.

Papers A (section 6.2, eq. 14–17) and B (section 3): `θ(t) = μ(ψ_t) + Σ_k c_{t,k} v_k(ψ_t)`.
"""

from collections.abc import Mapping
from typing import Any

import numpy as np
import scipy

from workbench.body.skeleton import N_ROOT, POSE_NAMES
from workbench.core.capabilities import DENSITY, MOTION, SEPARABLE, Traits, component_traits
from workbench.core.prior import PriorCapabilities
from workbench.core.side_information import FIXED_TORSO_ORIENTATION
from workbench.core.state_space import StateSpace
from workbench.motion.models.activities import ActivityModel
from workbench.motion.models.walking import ANGLES, CHANNEL_NAMES, WalkingModel
from workbench.priors import density
from workbench.priors.density import REFERENCE_RATE_HZ, AllColumnsFree, by_column, log_normal, smoothness
from workbench.utils.arrays import FloatArray
from workbench.utils.errors import InputError
from workbench.utils.kernel_cache import kernel
from workbench.utils.parallel import parallel_for

HEADING = POSE_NAMES.index("root_heading")
TABLE_PHASES = 256
TRANSITIONS = ("stationary", "A", "B")
INITIAL_COEFFICIENT_STD, INITIAL_PHASE_STD = 0.3, 0.015  # of the initial states, λ and cycles
ANGLE_SIGMA_RAD = 0.1  # standard deviation of an angle of the initial pose about the model's
_ROWS = 256  # minimum number of states per thread


class Cyclic(AllColumnsFree):
    """The cyclic prior over states {c, ψ, ρ, τ, θ}, D = d + 8, of a learned WalkingModel.

    Transitions of A and B:

        "A" (eq. 14–17)  c_t ~ N(c_t−1, (ελ)²)   μ_t ~ N(μ_t−1 + ρ, σ_μ²)   τ_t ~ N(T_t−1 [v Δt, 0, 0, 1]ᵀ, σ_τ²)
        "B" (section 3)  c, ρ, τ and θ random walks   ψ_t = ψ_t−1 + ρ_t−1 + noise

    and θ_t ~ N(θ_t−1, σ_θ²). Under A ρ is the mean of the training cycles and not part of the state, D = d + 7 (eq. 15
    has no drift). B has no learned torso speed v.

    Deviations of "stationary": coefficients shrink towards zero so that N(0, λ²) is stationary; a pure random walk
    leaves the learned range in long clips. The root moves along its heading over the ground rather than along the
    torso's own axis, so that a leaning torso does not sink. If the model has learned the root's sway
    (`walking.ROOT_CHANNELS`), {τ, θ} describe its uniform motion, and the sway is added.

    Parameters
    ----------
    model : the learned model.
    sigma_coefficients, sigma_phase, sigma_phase_speed, sigma_position, sigma_rotation : noise per frame at 30 Hz, which
        grows with the square root of the time step: fraction of λ_k (A eq. 14), cycles (A eq. 15), cycles/s (B), m
        along world x, y, z (A eq. 16) and rad of heading, pitch and roll (A eq. 17).
    initial_position_std, initial_rotation_std : of the initial states around the initial pose, m and rad. The phase
        speed has its learned distribution.
    penalty : of a fit on changes between frames at 14 Hz, by the fields of `Smoothness`.
    transition : "stationary", or as published in "A" or "B", with the noise above.

    Raises
    ------
    InputError : an unknown transition, or a noise that does not have three numbers.
    """

    @staticmethod
    def traits(keys: Mapping[str, Any]) -> Traits:
        """Declare a density, a motion model, independent columns, and a fixed torso orientation if it has no noise."""
        fixed = not np.any(keys.get("sigma_rotation", 1.0))
        return component_traits(DENSITY, MOTION, SEPARABLE, assumptions=(FIXED_TORSO_ORIENTATION,) if fixed else ())

    def __init__(
        self, model: WalkingModel, *,
        sigma_coefficients: float = 0.05, sigma_phase: float = 0.009, sigma_phase_speed: float = 0.01,
        sigma_position: tuple[float, float, float] = (0.01, 0.01, 0.01),
        sigma_rotation: tuple[float, float, float] = (0.01, 0.005, 0.005),
        initial_position_std: float = 0.01, initial_rotation_std: float = 0.02,
        penalty: Mapping[str, float] | None = None, transition: str = "stationary",
    ) -> None:  # fmt: skip
        if transition not in TRANSITIONS:
            raise InputError(f"prior: transition must be one of {', '.join(TRANSITIONS)}, found {transition!r}")
        for name, values in (("sigma_position", sigma_position), ("sigma_rotation", sigma_rotation)):
            if len(values) != 3:
                raise InputError(f"prior: {name} must hold three numbers, found {len(values)}")
        self.model, self.transition = model, transition
        self._has_sway = model.mean.shape[1] > len(CHANNEL_NAMES)
        self.parameters = POSE_NAMES
        groups = cycle_groups(tuple(f"c{k + 1}" for k in range(len(model.scales))), "λ")
        if transition == "A":
            del groups["phase_speed"]
        self.space = StateSpace.of(groups)
        self._sigma = by_column(
            self.space, coefficients=sigma_coefficients, phase=sigma_phase, **self._phase_speed(sigma_phase_speed),
            root_position=sigma_position, root_rotation=sigma_rotation,
        )  # fmt: skip
        self._initial_std = by_column(
            self.space, coefficients=INITIAL_COEFFICIENT_STD, phase=INITIAL_PHASE_STD,
            **self._phase_speed(model.cycle_rate_hz[1]),
            root_position=initial_position_std,
            root_rotation=np.where(np.array(sigma_rotation) > 0.0, initial_rotation_std, 0.0),
        )  # fmt: skip
        self._sigma_coefficients = sigma_coefficients
        self._smoothness, self._motion = smoothness(penalty), _motion_model(model)
        curves = np.concatenate([model.mean[None], model.components * model.scales[:, None, None]])
        self._table = np.ascontiguousarray(at_table_phases(curves).transpose(1, 0, 2))
        self._speed = np.ascontiguousarray(self._table[:, :, :1])

    @property
    def capabilities(self) -> PriorCapabilities:
        """The density, the learned cycle as a motion model and the penalty of a fit."""
        return PriorCapabilities(self, self._motion, self._smoothness, discrepancy=self.model.discrepancy)

    def sample_initial(self, pose: FloatArray, n: int, rng: np.random.Generator) -> FloatArray:
        """Sample n initial states (n, D) around the state that is nearest to an initial pose (P,)."""
        state = self.nearest(pose) + self._initial_std * rng.standard_normal((n, len(self.space)))
        state[:, self.space.slices["phase"]] %= 1.0
        return state

    def sample_transition(self, state: FloatArray, dt_s: float, rng: np.random.Generator) -> FloatArray:
        """Sample from p(state_t | state_t−1), (N, D), once for each state (N, D), `dt_s` seconds later."""
        moved = rng.standard_normal(state.shape)  # then in place: a copy of many states takes as long as sampling
        moved *= np.sqrt(dt_s * REFERENCE_RATE_HZ)
        moved *= self._sigma
        moved += state
        return self._drifted(state, moved, dt_s)

    def mean(self, state: FloatArray, dt_s: float) -> FloatArray:
        """Return the noise-free prediction (N, D) of states (N, D) after `dt_s` seconds."""
        return self._drifted(state, state.copy(), dt_s)

    def log_transition(self, previous: FloatArray, state: FloatArray, dt_s: float) -> FloatArray:
        """Return log p(state | previous), (...), of states (..., D) that broadcast; phase differences are wrapped."""
        mean = self.mean(previous.reshape(-1, len(self.space)), dt_s).reshape(previous.shape)
        return log_normal(
            density.state_difference(self.space, mean, state), np.sqrt(dt_s * REFERENCE_RATE_HZ) * self._sigma
        )

    def _drifted(self, state: FloatArray, moved: FloatArray, dt_s: float) -> FloatArray:
        """Add the drift of `dt_s` seconds to `moved`, which is `state` plus its noise."""
        slices = self.space.slices
        if self.transition == "stationary":
            shrinkage = np.sqrt(max(0.0, 1.0 - dt_s * REFERENCE_RATE_HZ * self._sigma_coefficients**2))
            moved[:, slices["coefficients"]] -= (1.0 - shrinkage) * state[:, slices["coefficients"]]
        cycles_hz = state[:, slices["phase_speed"]] if "phase_speed" in slices else self.model.cycle_rate_hz[0]
        moved[:, slices["phase"]] = (moved[:, slices["phase"]] + dt_s * cycles_hz) % 1.0
        if self.transition != "B":
            moved[:, slices["root_position"]] += self._root_displacement(state, dt_s)
        return moved

    def _root_displacement(self, state: FloatArray, dt_s: float) -> FloatArray:
        """Return the root's displacement (N, 3), m, at the learned speed along the heading; for "A" the torso axis."""
        slices = self.space.slices
        speed = decode(self._speed, state[:, slices["coefficients"]], state[:, slices["phase"]][:, 0])[:, 0]
        heading, pitch = state[:, slices["root_rotation"]].T[:2]
        displacement = np.zeros((len(state), 3))
        displacement[:, 0], displacement[:, 1] = np.cos(heading), np.sin(heading)
        if self.transition == "A":
            displacement[:, :2] *= np.cos(pitch)[:, None]
            displacement[:, 2] = -np.sin(pitch)
        displacement *= (dt_s * speed)[:, None]
        return displacement

    def pose(self, state: FloatArray) -> FloatArray:
        """Return the poses (N, P) of states (N, D)."""
        slices = self.space.slices
        channels = decode(self._table, state[:, slices["coefficients"]], state[:, slices["phase"]][:, 0])
        poses = np.empty((len(state), N_ROOT + len(CHANNEL_NAMES[ANGLES])))
        poses[:, :N_ROOT] = root = state[:, slices["root_position"].start : slices["root_rotation"].stop]
        if self._has_sway:
            poses[:, :N_ROOT] += _turned(channels[:, len(CHANNEL_NAMES) :], root[:, HEADING])
        poses[:, N_ROOT:] = channels[:, ANGLES]
        return poses

    def nearest(self, pose: FloatArray) -> FloatArray:
        """Return the state (D,) with the angles nearest to those of a pose (P,), at the `best_phase` of the table.

        Its phase speed is the learned mean.
        """
        angles = self._table[:, :, ANGLES]
        residuals = (pose[N_ROOT:] - angles[:, 0]) / ANGLE_SIGMA_RAD
        best, coefficients = best_phase(angles[:, 1:] / ANGLE_SIGMA_RAD, residuals)
        root = pose[:N_ROOT].copy()
        if self._has_sway:
            sway = decode(self._table, coefficients[None], np.array([best / TABLE_PHASES]))
            sway = sway[:, len(CHANNEL_NAMES) :]
            root -= _turned(sway, pose[HEADING : HEADING + 1] - sway[:, 2])[0]
        return by_column(
            self.space, coefficients=coefficients, phase=best / TABLE_PHASES,
            **self._phase_speed(self.model.cycle_rate_hz[0]), root_position=root[:3], root_rotation=root[3:],
        )  # fmt: skip

    def _phase_speed(self, value: float) -> dict[str, float]:
        """Return the value of the phase speed, if that is part of the state."""
        return {"phase_speed": value} if "phase_speed" in self.space.slices else {}


def cycle_groups(coefficients: tuple[str, ...], unit: str) -> dict[str, tuple[tuple[str, ...], str]]:
    """Return the first groups of columns of a cycle's state, see `StateSpace.of`; unit : of the coefficients."""
    return {
        "coefficients": (coefficients, unit), "phase": (("phase",), "cycle"),
        "phase_speed": (("phase_speed",), "cycle/s"), "root_position": (POSE_NAMES[:3], "m"),
        "root_rotation": (POSE_NAMES[3:N_ROOT], "rad"),
    }  # fmt: skip


def at_table_phases(curves: FloatArray) -> FloatArray:
    """Return periodic curves (n, M, C) at TABLE_PHASES phases (n, TABLE_PHASES, C), M ≤ TABLE_PHASES, by their Fourier
    series.

    It equals scipy.signal.resample, whose import takes a quarter of a second.
    """
    n_phases = curves.shape[1]
    spectrum = scipy.fft.rfft(curves, axis=1)
    if n_phases % 2 == 0 and n_phases != TABLE_PHASES:
        spectrum[:, n_phases // 2] *= 0.5  # the highest frequency becomes a pair
    series: FloatArray = scipy.fft.irfft(spectrum / (n_phases / TABLE_PHASES), TABLE_PHASES, axis=1)
    return series


def best_phase(basis: FloatArray, residuals: FloatArray) -> tuple[int, FloatArray]:
    """Return the number of the phase that explains angles best, and the coefficients (d,) there.

    At each of T phases the coefficients are the ridge regression, with their N(0, 1) prior, of the residuals (T, C)
    from the mean on the components (T, d, C), both over an angle's standard deviation. The phase with the smallest cost
    is chosen.
    """
    normal = basis @ basis.transpose(0, 2, 1) + np.eye(basis.shape[1])
    coefficients = np.linalg.solve(normal, basis @ residuals[:, :, None])[:, :, 0]
    errors = residuals - np.einsum("tk,tkc->tc", coefficients, basis)
    best = int(np.argmin((errors**2).sum(axis=1) + (coefficients**2).sum(axis=1)))
    return best, coefficients[best]


def _motion_model(model: WalkingModel) -> ActivityModel:
    """Return a cyclic model as a motion model of one activity.

    Its examples are cycles of mean speed and two standard deviations slower and faster. Root channels, such as the
    sway, are excluded, since a fit has separate root parameters.
    """
    mean_hz, std_hz = model.cycle_rate_hz
    return ActivityModel(
        angles=CHANNEL_NAMES[ANGLES], mean=model.mean[:, ANGLES], components=model.components[:, :, ANGLES],
        scales=model.scales, explained=np.array([model.explained]), scores=np.zeros((3, len(model.scales))),
        activities=("cycle",) * 3, cycle_rate_hz=mean_hz + std_hz * np.array([-2.0, 0.0, 2.0]),
        discrepancy=model.discrepancy,
    )  # fmt: skip


def _turned(sway: FloatArray, heading: FloatArray) -> FloatArray:
    """Return the change (N, 6) of the root's parameters in the world by ROOT_CHANNELS (N, 5) at headings (N,)."""
    lateral, others = sway[:, :1], sway[:, 1:]
    return np.hstack([-np.sin(heading)[:, None] * lateral, np.cos(heading)[:, None] * lateral, others])


def decode(table: FloatArray, coefficients: FloatArray, phase: FloatArray) -> FloatArray:
    """Return channels (N, C), μ(ψ) + Σ_k c_k v_k(ψ), at phases (N,) for coefficients (N, d), units of λ (B, section 3).

    It is a kernel rather than matrix products so that the result does not depend on the number of BLAS threads.

    Parameters
    ----------
    table : (M, 1 + d, C), the mean and the scaled components at M equidistant phases, interpolated linearly.
    coefficients : (N, d).
    phase : (N,), cycles.
    """
    channels = np.empty((len(phase), table.shape[2]))
    arguments = table, np.ascontiguousarray(coefficients), np.ascontiguousarray(phase), channels
    parallel_for(lambda first, last: _decode(first, last, *arguments), len(channels), _ROWS)
    return channels


@kernel()
def _decode(first: int, last: int, table: Any, coefficients: Any, phase: Any, channels: Any) -> None:
    n_phases, n_curves, n_channels = table.shape
    for n in range(first, last):
        position = (phase[n] % 1.0) * n_phases
        floor = int(np.floor(position))
        fraction = position - floor
        low, high = table[floor % n_phases], table[(floor + 1) % n_phases]
        for c in range(n_channels):
            channels[n, c] = (1.0 - fraction) * low[0, c] + fraction * high[0, c]
        for k in range(1, n_curves):
            a, b = (1.0 - fraction) * coefficients[n, k - 1], fraction * coefficients[n, k - 1]
            for c in range(n_channels):
                channels[n, c] += a * low[k, c] + b * high[k, c]
