"""What a part was built with, kept for whoever records it."""

from collections.abc import Mapping
from functools import wraps
from inspect import signature
from typing import Any, TypeVar

T = TypeVar("T")
_PLACE = "_keys_it_was_built_with"


def records_arguments(part: type[T]) -> type[T]:
    """Decorate a class whose objects do not keep their constructor's arguments as attributes, so that `kept` has them.

    Dataclasses have no need of it.
    """
    build = part.__init__

    @wraps(build)
    def build_and_keep(self: T, *arguments: Any, **keywords: Any) -> None:
        build(self, *arguments, **keywords)
        bound = signature(build).bind(self, *arguments, **keywords)
        bound.apply_defaults()
        object.__setattr__(self, _PLACE, dict(list(bound.arguments.items())[1:]))

    part.__init__ = build_and_keep  # type: ignore[method-assign, assignment]
    return part


def kept(part: object) -> Mapping[str, Any]:
    """The arguments that an object of a class decorated by `records_arguments` was built with, defaults too; else
    none."""
    found: Mapping[str, Any] = getattr(part, _PLACE, {})
    return found
