"""Constant-velocity prior within joint limits (paper A, section 6.1)."""

import logging
from collections.abc import Iterable, Mapping, Sequence
from types import MappingProxyType
from typing import Any

import numpy as np
import scipy

from workbench.body.shape import from_height
from workbench.body.skeleton import POSE_NAMES, person_skeleton, without_side
from workbench.body.skeleton import parameters as named_parameters
from workbench.core.capabilities import BODY_PARTS, DENSITY, SEPARABLE, Traits, component_traits
from workbench.core.prior import PriorCapabilities
from workbench.core.side_information import FIXED_OTHER_JOINTS
from workbench.core.state_space import StateSpace
from workbench.priors.density import REFERENCE_RATE_HZ, AllColumnsFree, log_normal, smoothness
from workbench.utils.arrays import BoolArray, FloatArray
from workbench.utils.errors import InputError

log = logging.getLogger(__name__)
INITIAL_VELOCITY_SCALE = 3.0  # standard deviation of the initial velocities, in multiples of sigma_velocity
UNLIMITED = 1e6
MIN_SCALE = 1e-30
FAR = 1e8  # standard deviations from the mean beyond which a truncated sample equals the nearer limit, to rounding
SIGMA = MappingProxyType({
    "root_position": 0.010, "root_rotation": 0.010, "neck": 0.020, "shoulder": 0.020, "shoulder_twist": 0.040,
    "elbow": 0.030, "hip": 0.015, "knee": 0.025,
})  # fmt: skip
"""σ^φ per frame at 30 Hz, m or rad. Our values, smaller for heavier limbs; the paper gives no numbers."""

SIGMA_VELOCITY = MappingProxyType({
    "root_position": 0.085, "root_rotation": 0.25, "neck": 0.45, "shoulder": 0.45, "shoulder_twist": 1.3,
    "elbow": 0.65, "hip": 0.70, "knee": 1.4,
})  # fmt: skip
"""σ^V per frame at 30 Hz, m/s or rad/s: changes of velocities between frames in 24 CMU clips, half of them walks."""


class Smooth(AllColumnsFree):
    """Constant velocity within hard limits for k of the pose's P parameters (paper A, section 6.1):

        φ_i,t ~ N(φ_i,t−1 + V_i,t−1 Δt, (σ_i^φ)²) given φ_i,t ∈ [φ_i,min, φ_i,max]
        V_i,t ~ N(e^(−damping Δt) V_i,t−1, (σ_i^V)²)

    A state holds the k moving parameters, their k velocities (m/s, rad/s) and, last, the P − k fixed parameters.

    Limits: the paper's density is a Gaussian inside the limits and 0 outside, which integrates to less than one near
    them. Samples are of the truncated normal, and `propose` weights them by that integral. Normalised, all have the
    same weight; as a limit does not change the velocity, a state whose mean is beyond it then stays just inside, about
    σ²/distance from it, until the velocity turns.

    Parameters
    ----------
    parameters : names of the moving parameters or of body parts (`skeleton.BODY_PARTS`); None: all of POSE_NAMES.
    sigma, sigma_velocity : standard deviations per frame at 30 Hz, growing with the square root of the time step. Keys
        are a parameter ("left_shoulder_twist"), a parameter of either side ("shoulder_twist") or a joint ("shoulder",
        "root_position"); the most specific key applies. Defaults: SIGMA and SIGMA_VELOCITY.
    damping : decay rate of the velocities, 1/s; 0 as in the paper.
    lower, upper : limits that replace the skeleton's, m or rad, with keys as for sigma.
    initial_pose_scale : standard deviation of the initial poses, in multiples of sigma.
    initial_uniform : parameters whose initial values are uniform within their limits.
    normalized : whether the density is normalised; False as in the paper. Moves that do not use a prior's proposal need
        a normalised one.
    penalty : of a fit on changes between frames at 14 Hz, by the fields of `Smoothness`.

    Raises
    ------
    InputError : an unknown name, a negative standard deviation, or inconsistent limits.
    """

    @staticmethod
    def traits(keys: Mapping[str, Any]) -> Traits:
        """Declare a density and independent columns for every joint, and that the other joints are fixed, if there are
        any."""
        partial = keys.get("parameters") is not None
        assumptions = (FIXED_OTHER_JOINTS,) if partial else ()
        return component_traits(DENSITY, SEPARABLE, BODY_PARTS, assumptions=assumptions)

    def __init__(
        self, *, parameters: Sequence[str] | None = None,
        sigma: Mapping[str, float] | None = None, sigma_velocity: Mapping[str, float] | None = None,
        damping: float = 0.0, lower: Mapping[str, float] | None = None, upper: Mapping[str, float] | None = None,
        initial_pose_scale: float = 2.0, initial_uniform: Sequence[str] = (),
        normalized: bool = True, penalty: Mapping[str, float] | None = None,
    ) -> None:  # fmt: skip
        for name, value in (("damping", damping), ("initial_pose_scale", initial_pose_scale)):
            if not 0.0 <= value < np.inf:
                raise InputError(f"prior: {name} must be zero or a positive number, found {value}")
        self.parameters = POSE_NAMES if parameters is None else named_parameters("prior: parameters", parameters)
        if not self.parameters:
            raise InputError("prior: parameters must name at least one parameter of the pose, found none")
        self.sigma = _deviations("sigma", self.parameters, sigma or {}, SIGMA)
        self.sigma_velocity = _deviations("sigma_velocity", self.parameters, sigma_velocity or {}, SIGMA_VELOCITY)
        self.limits = _limits(self.parameters, lower or {}, upper or {})
        self.damping, self.initial_pose_scale, self.normalized = damping, initial_pose_scale, normalized
        self._smoothness = smoothness(penalty)
        uniform = _checked_names("initial_uniform", initial_uniform, self.parameters)
        self._uniform = np.array([self.parameters.index(name) for name in uniform], dtype=np.int64)
        for i in self._uniform:
            if np.ptp(self.limits[i]) >= UNLIMITED:
                name = self.parameters[i]
                raise InputError(f"prior: initial_uniform: {name} has no limits; set lower and upper for it")
        fixed = tuple(name for name in POSE_NAMES if name not in self.parameters)
        units = {name: "m" if name in POSE_NAMES[:3] else "rad" for name in POSE_NAMES}
        moving, speeds = (tuple(units[name] + per for name in self.parameters) for per in ("", "/s"))
        space = StateSpace.of({}).appended("pose", self.parameters, moving)
        space = space.appended("velocity", tuple(f"{name}_velocity" for name in self.parameters), speeds)
        self.space = space.appended("fixed", fixed, tuple(units[name] for name in fixed))
        self._moving = [POSE_NAMES.index(name) for name in self.parameters]
        velocity_columns = (len(POSE_NAMES) + i for i in self._moving)
        self._state_columns = [*self._moving, *velocity_columns, *map(POSE_NAMES.index, fixed)]
        self._pose_columns = [self.space.names.index(name) for name in POSE_NAMES]

    @property
    def capabilities(self) -> PriorCapabilities:
        """The density and the penalty of a fit."""
        return PriorCapabilities(density=self, smoothness=self._smoothness)

    def sample_initial(self, pose: FloatArray, n: int, rng: np.random.Generator) -> FloatArray:
        """Sample n initial states (n, D) around an initial pose (P,), within the limits, with velocities around zero.

        A parameter outside its limits is moved just inside; a warning is logged.
        """
        for i, (name, (low, high)) in enumerate(zip(self.parameters, self.limits, strict=True)):
            value = pose[self._moving[i]]
            if i not in self._uniform and not low <= value <= high:
                log.warning(
                    "initial pose: %s is %.3f, outside its limits [%.3f, %.3f]; moved inside", name, value, low, high
                )
        state = self.enter(np.repeat(pose[None], n, axis=0), np.zeros((n, len(POSE_NAMES))))
        moving, velocity = self.space.slices["pose"], self.space.slices["velocity"]
        low, high = self.limits.T
        uniforms = _open_uniforms((n, len(self.parameters)), rng)
        state[:, moving] = truncated_normal(state[:, moving], self.initial_pose_scale * self.sigma, low, high, uniforms)
        uniform = low[self._uniform] + uniforms[:, self._uniform] * (high - low)[self._uniform]
        state[:, self._uniform] = uniform  # the moving parameters are the state's first columns
        state[:, velocity] = (
            INITIAL_VELOCITY_SCALE * self.sigma_velocity * rng.standard_normal(state[:, velocity].shape)
        )
        return state

    def enter(self, poses: FloatArray, velocities: FloatArray) -> FloatArray:
        """Return the states (N, D) of poses (N, P) with velocities (N, P), m/s and rad/s."""
        return np.take(np.concatenate([poses, velocities], axis=1), self._state_columns, axis=1)

    def propose(self, state: FloatArray, dt_s: float, rng: np.random.Generator) -> tuple[FloatArray, FloatArray]:
        """Sample as `sample_transition`; return states (N, D) and log weights (N,): of the probability within the
        limits, zero if normalised."""
        moved = self.sample_transition(state, dt_s, rng)
        if self.normalized:
            return moved, np.zeros(len(state))
        predicted = state[:, self.space.slices["pose"]] + dt_s * state[:, self.space.slices["velocity"]]
        growth = np.sqrt(dt_s * REFERENCE_RATE_HZ)
        return moved, _log_mass(predicted, growth * self.sigma, *self.limits.T).sum(axis=1)

    def sample_transition(self, state: FloatArray, dt_s: float, rng: np.random.Generator) -> FloatArray:
        """Sample from p(state_t | state_t−1), normalised, (N, D), once for each state (N, D), `dt_s` seconds later."""
        moving, velocity = self.space.slices["pose"], self.space.slices["velocity"]
        low, high = self.limits.T
        growth = np.sqrt(dt_s * REFERENCE_RATE_HZ)
        predicted = state[:, moving] + dt_s * state[:, velocity]
        uniforms = _open_uniforms(predicted.shape, rng)
        noise = growth * self.sigma_velocity * rng.standard_normal(predicted.shape)
        moved = state.copy()
        moved[:, moving] = truncated_normal(predicted, growth * self.sigma, low, high, uniforms)
        moved[:, velocity] = np.exp(-self.damping * dt_s) * state[:, velocity] + noise
        return moved

    def mean(self, state: FloatArray, dt_s: float) -> FloatArray:
        """Return the noise-free prediction (N, D) of states (N, D) after `dt_s` seconds, within the limits."""
        moving, velocity = self.space.slices["pose"], self.space.slices["velocity"]
        moved = state.copy()
        moved[:, moving] = np.clip(state[:, moving] + dt_s * state[:, velocity], *self.limits.T)
        moved[:, velocity] = np.exp(-self.damping * dt_s) * state[:, velocity]
        return moved

    def log_transition(self, previous: FloatArray, state: FloatArray, dt_s: float) -> FloatArray:
        """Return log p(state | previous), (...), of states (..., D) that broadcast: −∞ beyond a limit."""
        moving, velocity, fixed = (self.space.slices[name] for name in ("pose", "velocity", "fixed"))
        growth = np.sqrt(dt_s * REFERENCE_RATE_HZ)
        predicted = previous[..., moving] + dt_s * previous[..., velocity]
        change = state[..., velocity] - np.exp(-self.damping * dt_s) * previous[..., velocity]
        same = (state[..., fixed] == previous[..., fixed]).all(axis=-1)
        pose = _log_normal_within(state[..., moving], predicted, growth * self.sigma, *self.limits.T)
        if self.normalized:
            pose = pose - _log_mass(predicted, growth * self.sigma, *self.limits.T)
        pose = pose.sum(axis=-1)
        return np.where(same, pose + log_normal(change, growth * self.sigma_velocity), -np.inf)

    def pose(self, state: FloatArray) -> FloatArray:
        """Return the poses (N, P) of states (N, D)."""
        return np.take(state, self._pose_columns, axis=1)


def truncated_normal(
    mean: FloatArray, deviation: FloatArray, low: FloatArray, high: FloatArray, uniforms: FloatArray
) -> FloatArray:
    """Return quantiles at `uniforms`, in (0, 1), of normal distributions truncated to [low, high]; all broadcast.

    x = mean + deviation Φ⁻¹(Φ(a) + u (Φ(b) − Φ(a))), a and b the standardised limits, computed with log Φ in the lower
    tail, where it is accurate for any limits. A deviation of zero gives the mean, or the nearest limit.
    """
    a, b, upper = _lower_tail(mean, deviation, low, high)
    u = np.where(upper, 1.0 - uniforms, uniforms)
    log_b = scipy.special.log_ndtr(b)
    z = scipy.special.ndtri_exp(log_b + np.log(u + (1.0 - u) * np.exp(scipy.special.log_ndtr(a) - log_b)))
    return np.clip(mean + deviation * np.where(upper, -z, z), low, high)  # clips rounding errors only


def _log_normal_within(
    values: FloatArray, mean: FloatArray, deviation: FloatArray, low: FloatArray, high: FloatArray
) -> FloatArray:
    """Return log densities of the normal at values; all broadcast. −∞ beyond the limits.

    A deviation of zero has no density: 0 at the mean, or at the nearest limit, and −∞ elsewhere.
    """
    scale = np.maximum(deviation, MIN_SCALE)
    density = -0.5 * ((values - mean) / scale) ** 2 - np.log(np.sqrt(2.0 * np.pi) * scale)
    density = np.where(deviation > 0.0, density, np.where(values == np.clip(mean, low, high), 0.0, -np.inf))
    return np.where((low <= values) & (values <= high), density, -np.inf)


def _log_mass(mean: FloatArray, deviation: FloatArray, low: FloatArray, high: FloatArray) -> FloatArray:
    """Return the log probability of a normal within the limits; all broadcast. 0 for a deviation of zero."""
    a, b, _ = _lower_tail(mean, deviation, low, high)
    with np.errstate(divide="ignore"):  # limits beyond FAR have no probability mass between them
        log_mass = scipy.special.log_ndtr(b) + np.log(-np.expm1(scipy.special.log_ndtr(a) - scipy.special.log_ndtr(b)))
    return np.where(deviation > 0.0, log_mass, 0.0)


def _lower_tail(
    mean: FloatArray, deviation: FloatArray, low: FloatArray, high: FloatArray
) -> tuple[FloatArray, FloatArray, BoolArray]:
    """Return standardised limits, mirrored into the lower tail if above the mean, and where they are mirrored."""
    scale = np.maximum(deviation, MIN_SCALE)
    a, b = np.clip((low - mean) / scale, -FAR, FAR), np.clip((high - mean) / scale, -FAR, FAR)
    upper = a + b > 0.0
    return np.where(upper, -b, a), np.where(upper, -a, b), upper


def _open_uniforms(shape: tuple[int, ...], rng: np.random.Generator) -> FloatArray:
    """Return uniform numbers in (0, 1): zero, which gives −∞ without limits, is replaced by 2⁻⁵³."""
    return np.maximum(rng.random(shape), 2.0**-53)


def _keys(parameter: str) -> tuple[str, str, str]:
    """Return the keys under which a parameter's value may be listed, the most specific first."""
    either_side = without_side(parameter)
    joint = either_side.partition("_")[0]
    if joint == "root":
        joint = "root_position" if parameter in POSE_NAMES[:3] else "root_rotation"
    return parameter, either_side, joint


def _listed(
    option: str, parameters: tuple[str, ...], values: Mapping[str, float], default: Mapping[str, float]
) -> FloatArray:
    """Return the parameters' values (k,) from a table, or from the default table where it has no entry."""
    _checked_names(option, values, {key for parameter in POSE_NAMES for key in _keys(parameter)})
    return np.array([
        next(float(table[key]) for table in (values, default) for key in _keys(parameter) if key in table)
        for parameter in parameters
    ])  # fmt: skip


def _deviations(
    option: str, parameters: tuple[str, ...], values: Mapping[str, float], default: Mapping[str, float]
) -> FloatArray:
    for key, value in values.items():
        if not 0.0 <= value < np.inf:
            raise InputError(f"prior: {option}.{key} must be zero or a positive number, found {value}")
    return _listed(option, parameters, values, default)


def _limits(parameters: tuple[str, ...], lower: Mapping[str, float], upper: Mapping[str, float]) -> FloatArray:
    """Return the limits (k, 2) of the moving parameters; the skeleton's are the same for every shape."""
    ends = zip(("lower", "upper"), (lower, upper), person_skeleton(from_height(1.75)).limits.T, strict=True)
    columns = [
        _listed(name, parameters, values, dict(zip(POSE_NAMES, limit, strict=True))) for name, values, limit in ends
    ]
    limits = np.stack(columns, axis=1)
    for name, (low, high) in zip(parameters, limits, strict=True):
        if not -UNLIMITED <= low < high <= UNLIMITED:
            raise InputError(f"prior: lower and upper of {name} must be increasing numbers, found {low} and {high}")
    return limits


def _checked_names(option: str, names: Iterable[str], allowed: Iterable[str]) -> tuple[str, ...]:
    """Return the names as a tuple; raises InputError for a name that is unknown or duplicate."""
    names, allowed = tuple(names), tuple(allowed)
    for name in names:
        if name not in allowed or names.count(name) > 1:
            problem = "named twice" if name in allowed else f"unknown, expected some of {', '.join(sorted(allowed))}"
            raise InputError(f"prior: {option}: {name!r} is {problem}")
    return names
