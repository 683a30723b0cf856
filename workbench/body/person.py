"""Whose body is tracked: measured by the dataset, of a given height, or read from a motion file."""

from collections.abc import Mapping
from dataclasses import fields
from types import MappingProxyType

from workbench.body.limbs import Body, person
from workbench.body.shape import Shape, from_height
from workbench.errors import InputError

Lengths = Mapping[str, float]
NO_LENGTHS: Lengths = MappingProxyType({})


def of_dataset(dataset_shape: Shape | None, full_body: Body | None = None, *, scale: float = 1.0) -> Body:
    """The person as the dataset measured them, all lengths times `scale`; InputError where they did not.

    full_body: of the dataset's own skeleton, where that is not the person's.
    """
    if full_body is not None:
        return full_body.scaled(scale)
    if dataset_shape is None:
        raise InputError("body: this dataset does not know the person's size; choose body=height body.height_m=…")
    return person(dataset_shape.scaled(scale))


def of_height(dataset_shape: Shape | None, *, height_m: float, lengths: Lengths = NO_LENGTHS) -> Body:
    """An average person of a height, m, with single lengths (m) given by name, e.g. {thigh: 0.40}."""
    given = dict(lengths)
    plain = {field.name for field in fields(Shape) if field.type is float}
    if unknown := sorted(set(given) - plain):
        raise InputError(f"body: unknown length {unknown[0]!r}, expected one of {', '.join(sorted(plain))}")
    return person(from_height(height_m, **given))
