"""The walking prior of paper A, section 6.2: the cyclic prior over a model learned from walking cycles."""

from collections.abc import Sequence

from workbench.learning.training import walking_model
from workbench.priors.cyclic import Cyclic


def walking(
    *,
    motions: str = "builtin",
    data: str | None = None,
    cache: str = "~/.cache/workbench",
    subjects: Sequence[str] = ("02", "05", "06", "07", "08", "16", "32", "39"),
    variance: float = 0.95,
    n_components: int | None = None,
    scaling: str = "none",
    sigma_coefficients: float = 0.05,
    sigma_phase: float = 0.009,
    sigma_phase_speed: float = 0.01,
    sigma_position: tuple[float, float, float] = (0.01, 0.01, 0.01),
    sigma_rotation: tuple[float, float, float] = (0.01, 0.005, 0.005),
    start_coefficients: float = 0.3,
    start_phase: float = 0.015,
    start_position: float = 0.01,
    start_rotation: float = 0.02,
) -> Cyclic:
    """Learn (or take from the cache) the walking model and put the cyclic prior on it.

    motions, data, cache, subjects, variance, n_components, scaling: see `learning.training.walking_model`.
    sigma_*, start_*: see `Cyclic`. Raises InputError when the motions cannot be read.
    """
    model = walking_model(
        motions,
        data=data,
        cache=cache,
        subjects=subjects,
        variance=variance,
        n_components=n_components,
        scaling=scaling,
    )
    return Cyclic(
        model,
        sigma_coefficients=sigma_coefficients,
        sigma_phase=sigma_phase,
        sigma_phase_speed=sigma_phase_speed,
        sigma_position=sigma_position,
        sigma_rotation=sigma_rotation,
        start_coefficients=start_coefficients,
        start_phase=start_phase,
        start_position=start_position,
        start_rotation=start_rotation,
    )
