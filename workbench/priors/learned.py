"""A prior and how its model is learned, as one factory that a configuration can name."""

from collections.abc import Callable
from inspect import Signature, signature
from typing import Any, TypeVar, get_type_hints

from workbench.core.traits import Traits

P = TypeVar("P")


def learned(name: str, module: str, learn: Callable[..., Any], prior: Callable[..., P]) -> Callable[..., P]:
    """The function `module.name` that learns a model and puts the prior on it.

    Its keyword parameters are those of `learn` and those of the prior but the first, which is the model; so neither
    side's are written twice, and a configuration's keys are read off its signature like any other's.
    """
    of_model, of_prior = signature(learn).parameters, list(signature(prior).parameters.values())[1:]

    def factory(**given: Any) -> P:
        model = learn(**{key: value for key, value in given.items() if key in of_model})
        return prior(model, **{key: value for key, value in given.items() if key not in of_model})

    factory.__name__ = factory.__qualname__ = name
    factory.__module__ = module
    factory.__doc__ = f"`{prior.__name__}` on what `{learn.__name__}` learns; parameters and what is raised: see there."
    factory.__annotations__ = {**get_type_hints(prior.__init__), **get_type_hints(learn), "return": prior}
    factory.traits = getattr(prior, "traits", Traits())  # type: ignore[attr-defined]
    factory.__signature__ = Signature([*of_model.values(), *of_prior], return_annotation=prior)  # type: ignore[attr-defined]
    return factory
