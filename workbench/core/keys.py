"""The constructor arguments of components, for the recording."""

from collections.abc import Mapping
from functools import wraps
from inspect import signature
from typing import Any, TypeVar

T = TypeVar("T")
_ATTRIBUTE = "_constructor_arguments"


def records_arguments(component: type[T]) -> type[T]:
    """Decorate a class whose objects do not store their constructor's arguments as attributes.

    `constructor_arguments` then returns them. Dataclasses do not need it.
    """
    build = component.__init__

    @wraps(build)
    def build_and_record(self: T, *arguments: Any, **keywords: Any) -> None:
        build(self, *arguments, **keywords)
        bound = signature(build).bind(self, *arguments, **keywords)
        bound.apply_defaults()
        object.__setattr__(self, _ATTRIBUTE, dict(list(bound.arguments.items())[1:]))

    component.__init__ = build_and_record  # type: ignore[method-assign, assignment]
    return component


def constructor_arguments(component: object) -> Mapping[str, Any]:
    """Return the constructor's arguments, with defaults, of an object whose class `records_arguments`; else none."""
    arguments: Mapping[str, Any] = getattr(component, _ATTRIBUTE, {})
    return arguments
