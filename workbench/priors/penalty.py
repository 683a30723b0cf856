"""The penalty that a prior gives a fit: by how much its poses may change from frame to frame."""

from collections.abc import Mapping
from dataclasses import fields

import numpy as np

from workbench.core.prior import Smoothness
from workbench.errors import InputError


def smoothness(penalty: Mapping[str, float] | None) -> Smoothness:
    """`Smoothness` with the fields that are given, positive numbers; the others keep their defaults.

    Raises InputError for an unknown field and for a number that is none or not positive.
    """
    given, known = dict(penalty or {}), [field.name for field in fields(Smoothness)]
    for name, value in given.items():
        if name not in known:
            raise InputError(f"prior: penalty: expected some of {', '.join(known)}, found {name!r}")
        if not 0.0 < value < np.inf:
            raise InputError(f"prior: penalty.{name} must be a positive number, found {value}")
    return Smoothness(**given)
