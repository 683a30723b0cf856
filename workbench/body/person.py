"""The body of an average person."""

from collections.abc import Mapping
from dataclasses import fields
from types import MappingProxyType

from workbench.body.limbs import Body, person
from workbench.body.shape import Shape, from_height
from workbench.errors import InputError

NO_LENGTHS: Mapping[str, float] = MappingProxyType({})


def of_height(*, height_m: float, lengths: Mapping[str, float] = NO_LENGTHS) -> Body:
    """Return an average person of a height, m, with single lengths (m) by name, e.g. {thigh: 0.40}; raises InputError
    for an unknown length and what `from_height` refuses."""
    plain = {field.name for field in fields(Shape) if field.type is float}
    if unknown := sorted(set(lengths) - plain):
        raise InputError(f"body: unknown length {unknown[0]!r}, expected one of {', '.join(sorted(plain))}")
    return person(from_height(height_m, **lengths))
