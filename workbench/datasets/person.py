"""The body of the person tracked: as the dataset knows them, or an average one."""

from collections.abc import Mapping
from dataclasses import fields
from types import MappingProxyType
from typing import Any

from workbench.body.limbs import Body, person, with_neck_and_feet
from workbench.body.shape import Shape, from_height
from workbench.core.capabilities import Traits, component_traits, declares_traits
from workbench.core.dataset import SequenceInfo
from workbench.core.side_information import HEIGHT, LIMB_LENGTHS, LIMB_RADII
from workbench.utils.errors import InputError

_NO_LENGTHS: Mapping[str, float] = MappingProxyType({})


@declares_traits(component_traits(assumptions=(LIMB_LENGTHS, LIMB_RADII)))
def of_dataset(info: SequenceInfo, *, scale: float = 1.0) -> Body:
    """Return the tracked body as the dataset knows it, or else its person as measured, all lengths times `scale`;
    raises InputError where it knows neither."""
    if info.body is not None:
        return info.body.scaled(scale)
    if info.shape is None:
        raise InputError("body: this dataset does not know the person's size; choose body=height body.height_m=…")
    return person(info.shape.scaled(scale))


def _height_traits(keys: Mapping[str, Any]) -> Traits:
    """Declare the height, and the limb lengths where some are given."""
    return component_traits(assumptions=(HEIGHT, LIMB_LENGTHS) if keys.get("lengths") else (HEIGHT,))


@declares_traits(_height_traits)
def of_height(*, height_m: float, lengths: Mapping[str, float] = _NO_LENGTHS, feet: bool = False) -> Body:
    """Return an average person of a height, m, with single lengths (m) by name, e.g. {thigh: 0.40}, and with neck and
    feet if wanted; raises InputError for an unknown length and what `from_height` refuses."""
    plain = {field.name for field in fields(Shape) if field.type is float}
    if unknown := sorted(set(lengths) - plain):
        raise InputError(f"body: unknown length {unknown[0]!r}, expected one of {', '.join(sorted(plain))}")
    body = person(from_height(height_m, **lengths))
    return with_neck_and_feet(body) if feet else body
