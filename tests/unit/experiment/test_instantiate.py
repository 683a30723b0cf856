"""Types of the values of components."""

from pathlib import Path

import numpy as np
import pytest

from workbench.core.prior import Smoothness
from workbench.experiment.config.instantiate import _check_type
from workbench.utils.errors import InputError


@pytest.mark.parametrize(
    ("hint", "value", "accepted"),
    [
        (Path, "a.bvh", True), (np.ndarray, [1.0], True),  # for the component to check
        (list, [1], True), (list, 3, False), (dict, {"a": 1}, True), (dict, [1], False), (int | None, None, True),
        (int | None, "x", False), (Smoothness | None, 3, False), (float, 2, True), (int, 2.0, False),
    ],
)  # fmt: skip
def test_values_have_the_types_that_a_configuration_can_express(hint, value, accepted):
    if accepted:
        _check_type(value, hint, "prior.key")
        return
    with pytest.raises(InputError, match=r"prior\.key: expected"):
        _check_type(value, hint, "prior.key")
