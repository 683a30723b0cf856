"""Priors that a configuration can name together with the motions they are learned from."""

from collections.abc import Callable
from inspect import Signature, signature
from typing import Any, TypeVar, get_type_hints

from workbench.core.capabilities import Traits
from workbench.motion.models.training import (
    activity_model,
    cyclic_model,
    gait_model,
    linear_motion,
    motion_windows,
    walking_model,
)
from workbench.priors.activity import Activity
from workbench.priors.cyclic import Cyclic
from workbench.priors.linear import Linear

P = TypeVar("P")


def learned(name: str, learn: Callable[..., Any], prior: Callable[..., P]) -> Callable[..., P]:
    """Make the function of this module, called `name`, that learns a model and puts the prior on it.

    Its keyword parameters are those of `learn` and those of the prior but the first, which is the model; so neither
    side's are written twice, and a configuration's keys are read off its signature like any other's.
    """
    of_model, of_prior = signature(learn).parameters, list(signature(prior).parameters.values())[1:]

    def factory(**given: Any) -> P:
        model = learn(**{key: value for key, value in given.items() if key in of_model})
        return prior(model, **{key: value for key, value in given.items() if key not in of_model})

    factory.__name__ = factory.__qualname__ = name
    factory.__doc__ = f"`{prior.__name__}` on what `{learn.__name__}` learns; parameters and what is raised: see there."
    factory.__annotations__ = {**get_type_hints(prior.__init__), **get_type_hints(learn), "return": prior}
    factory.traits = getattr(prior, "traits", Traits())  # type: ignore[attr-defined]
    factory.__signature__ = Signature([*of_model.values(), *of_prior], return_annotation=prior)  # type: ignore[attr-defined]
    return factory


walking = learned("walking", walking_model, Cyclic)
"""Paper A, section 6.2: the cyclic prior over a model learned from whole walking cycles, found by gait events."""
gait = learned("gait", gait_model, Cyclic)
"""Paper A's, with how the root sways in a cycle learned, too, so that less is left to noise."""
cyclic = learned("cyclic", cyclic_model, Cyclic)
"""Paper B: the same prior over a model learned from any cyclic motion with gaps."""
linear = learned("linear", linear_motion, Linear)
"""A linear-Gaussian model of all motions."""
activity = learned("activity", activity_model, Activity)
"""Paper D: one model of walking and running, which least squares fits and a particle filter samples."""


def __getattr__(name: str) -> Callable[..., Any]:
    """Make `implicit`, paper C's database of motions as a prior, when it is asked for: its import takes longest."""
    if name != "implicit":
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    from workbench.priors.implicit import Implicit

    made = globals()[name] = learned(name, motion_windows, Implicit)
    return made
