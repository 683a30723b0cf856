"""Tracked bodies: the dataset's person, or an average person of a given height."""

from collections.abc import Mapping
from dataclasses import fields
from types import MappingProxyType
from typing import Any

from workbench.body.limbs import Body, person, person_on, with_neck_and_feet
from workbench.body.shape import Shape, from_height
from workbench.core.capabilities import Traits, component_traits, declares_traits
from workbench.core.dataset import SequenceInfo
from workbench.core.side_information import HEIGHT, LIMB_LENGTHS, LIMB_RADII
from workbench.utils.errors import InputError

_NO_LENGTHS: Mapping[str, float] = MappingProxyType({})


@declares_traits(component_traits(assumptions=(LIMB_LENGTHS, LIMB_RADII)))
def of_dataset(info: SequenceInfo, *, scale: float = 1.0) -> Body:
    """Return the dataset's tracked body, or else its person's, all lengths times `scale`; raises InputError for a
    dataset with neither."""
    if info.body is not None:
        return info.body.scaled(scale)
    if info.shape is None:
        raise InputError("body: the dataset has no body measurements of the person; set body=height body.height_m=…")
    return person(info.shape.scaled(scale))


def _height_traits(keys: Mapping[str, Any]) -> Traits:
    """Declare the height, and the limb lengths where some are set."""
    return component_traits(assumptions=(HEIGHT, LIMB_LENGTHS) if keys.get("limb_lengths_m") else (HEIGHT,))


@declares_traits(_height_traits)
def of_height(
    *, height_m: float, limb_lengths_m: Mapping[str, float] = _NO_LENGTHS, neck_and_feet: bool = False,
    skeleton: str = "person",
) -> Body:  # fmt: skip
    """Return an average person of a height.

    limb_lengths_m: single lengths by name that replace the average, m, e.g. {thigh: 0.40}. neck_and_feet: whether the
    body of the plain skeleton has neck and feet. skeleton: see `person_on`. Raises InputError for an unknown length,
    and as `from_height` and `person_on` do.
    """
    names = {field.name for field in fields(Shape) if field.type is float}
    if unknown := sorted(set(limb_lengths_m) - names):
        expected = ", ".join(sorted(names))
        raise InputError(f"body: limb_lengths_m: unknown length {unknown[0]!r}, expected one of {expected}")
    body = person_on(skeleton, from_height(height_m, **limb_lengths_m))
    return with_neck_and_feet(body) if neck_and_feet and "neck" not in body.limbs.names else body
