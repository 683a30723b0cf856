"""A bound on references of a configuration to its own parts: a few lines that each refer twenty times to the one before
stand for more than any memory holds."""

from functools import wraps
from typing import Any

from omegaconf.base import Container
from omegaconf.errors import InterpolationResolutionError

from workbench.limits import MOST_REFERENCES

_BOUNDED = "bounded_by_the_workbench"


def bound_references() -> None:
    """Have OmegaConf refuse a value that stands for more than MOST_REFERENCES others which refer to others; its error
    is an InterpolationResolutionError."""
    whole = Container.resolve_parse_tree
    if hasattr(whole, _BOUNDED):
        return
    pending: list[int] = []  # one number while a value is resolved: how many were, within it

    @wraps(whole)
    def counted(*arguments: Any, **keys: Any) -> Any:
        first = not pending
        pending[:] = [1] if first else [pending[0] + 1]
        try:
            if pending[0] > MOST_REFERENCES:
                raise InterpolationResolutionError(f"expected at most {MOST_REFERENCES} references in one, found more")
            return whole(*arguments, **keys)
        finally:
            if first:
                pending.clear()

    setattr(counted, _BOUNDED, True)
    setattr(Container, "resolve_parse_tree", counted)  # noqa: B010 (a method of another's class)
