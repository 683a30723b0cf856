"""Priors with their training motions, as targets of a configuration.

The parameters of a function are those of the model (`motion.models.training`) and those of the prior; they are
documented there, as are the errors.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from functools import partial
from inspect import signature
from typing import Any, TypeVar

from workbench.core.capabilities import declares_traits
from workbench.motion.models import training
from workbench.motion.models.training import WALKERS
from workbench.priors.activity import Activity
from workbench.priors.cyclic import Cyclic
from workbench.priors.implicit import Implicit
from workbench.priors.linear import Linear

P = TypeVar("P")
_CACHE = "~/.cache/workbench"


@declares_traits(Cyclic.traits)
def walking(
    *, motions: str = "builtin", data: str | None = None, cache: str = _CACHE, subjects: Sequence[str] = WALKERS,
    exclude: Sequence[str] = (), variance: float = 0.95, n_components: int | None = 8, scaling: str = "joints",
    torso_speed: str = "forward",
    sigma_coefficients: float = 0.05, sigma_phase: float = 0.009, sigma_phase_speed: float = 0.01,
    sigma_position: tuple[float, float, float] = (0.01, 0.01, 0.01),
    sigma_rotation: tuple[float, float, float] = (0.01, 0.005, 0.005), initial_position_std: float = 0.01,
    initial_rotation_std: float = 0.02, penalty: Mapping[str, float] | None = None, transition: str = "stationary",
) -> Cyclic:  # fmt: skip
    """Return paper A's prior (section 6.2): a model of whole walking cycles between gait events."""
    return _learned(training.walking_model, Cyclic, locals())


@declares_traits(Cyclic.traits)
def gait(
    *, motions: str = "builtin", data: str | None = None, cache: str = _CACHE, subjects: Sequence[str] = WALKERS,
    exclude: Sequence[str] = (), n_components: int = 8,
    sigma_coefficients: float = 0.05, sigma_phase: float = 0.009, sigma_phase_speed: float = 0.01,
    sigma_position: tuple[float, float, float] = (0.01, 0.01, 0.01),
    sigma_rotation: tuple[float, float, float] = (0.01, 0.005, 0.005), initial_position_std: float = 0.01,
    initial_rotation_std: float = 0.02, penalty: Mapping[str, float] | None = None, transition: str = "stationary",
) -> Cyclic:  # fmt: skip
    """Return paper A's prior with a learned sway of the root, which reduces the noise."""
    return _learned(partial(training.walking_model, include_root=True), Cyclic, locals())


@declares_traits(Cyclic.traits)
def cyclic(
    *, motions: str = "builtin", data: str | None = None, cache: str = _CACHE, subjects: Sequence[str] = WALKERS,
    exclude: Sequence[str] = (), n_components: int = 8, missing_fraction: float = 0.0, as_published: bool = False,
    sigma_coefficients: float = 0.05, sigma_phase: float = 0.009, sigma_phase_speed: float = 0.01,
    sigma_position: tuple[float, float, float] = (0.01, 0.01, 0.01),
    sigma_rotation: tuple[float, float, float] = (0.01, 0.005, 0.005), initial_position_std: float = 0.01,
    initial_rotation_std: float = 0.02, penalty: Mapping[str, float] | None = None, transition: str = "stationary",
) -> Cyclic:  # fmt: skip
    """Return paper B's prior: a model of any cyclic motion with gaps."""
    return _learned(training.cyclic_model, Cyclic, locals())


@declares_traits(Linear.traits)
def linear(
    *, motions: str = "recorded", data: str | None = None, cache: str = _CACHE, exclude: Sequence[str] = (),
    activities: Sequence[str] = (), rate_hz: float | None = None, frames_hz: float | None = None,
    noise_scale: float = 1.0,
) -> Linear:  # fmt: skip
    """Return the linear prior over all motions.

    Generated gaits are of average people who walk: their prior over postures is omitted, as it would exclude those of
    other people and activities. A fit then has the angles' nominal values.
    """
    prior = _learned(training.linear_motion, Linear, locals())
    return replace(prior, model=replace(prior.model, pose_prior=None)) if motions == "builtin" else prior


@declares_traits(Activity.traits)
def activity(
    *, motions: str = "builtin", data: str | None = None, cache: str = _CACHE, exclude: Sequence[str] = (),
    activities: Sequence[str] = ("walk", "run"), angles: Sequence[str] = ("body",), variance: float = 0.9,
    n_components: int | None = None, skeleton: str = "person", sigma_coefficients: float = 0.2,
    sigma_phase: float = 0.02, sigma_phase_speed: float = 0.02, sigma_position: float = 0.01,
    sigma_rotation: tuple[float, float, float] = (0.01, 0.005, 0.005), sigma_velocity: float = 0.1,
    penalty: Mapping[str, float] | None = None,
) -> Activity:  # fmt: skip
    """Return paper D's model of walking and running as a prior, for least squares and particle filters."""
    return _learned(training.activity_model, Activity, locals())


@declares_traits(Implicit.traits)
def implicit(
    *, motions: str = "recorded", data: str | None = None, cache: str = _CACHE, exclude: Sequence[str] = (),
    activities: Sequence[str] = (), angles: Sequence[str] = ("body",), include_root: bool = True,
    rate_hz: float | None = None, window_frames: int | None = None, frames_hz: float | None = None,
    scaling: str = "deviations", search: str = "exact", beta: float = 0.05, tail_probability: float = 0.01,
    leaf: str = "gaussian", importance_correction: bool = False, prediction: str = "blend", blend_rate: float = 0.1,
    velocity_noise_fraction: float = 1.0,
    sigma_position: tuple[float, float, float] = (0.01, 0.01, 0.005),
    sigma_rotation: tuple[float, float, float] = (0.02, 0.01, 0.01), sigma_angles: float | Sequence[float] = 0.02,
) -> Implicit:  # fmt: skip
    """Return paper C's implicit prior: a searched database of motions."""
    return _learned(training.motion_windows, Implicit, locals())


def _learned(learn: Callable[..., Any], prior: Callable[..., P], arguments: Mapping[str, Any]) -> P:
    """Return the prior on the model that `learn` makes; each gets the arguments that it has."""
    model_names = signature(learn).parameters
    model = learn(**{key: value for key, value in arguments.items() if key in model_names})
    return prior(model, **{key: value for key, value in arguments.items() if key not in model_names})
