"""Ranges of parameters: the values that they contain, and the error for a value out of range."""

from types import SimpleNamespace

import numpy as np
import pytest

from workbench.core.checks import (
    BELOW_1,
    FINITE,
    INSIDE_UNIT,
    POSITIVE,
    UNIT,
    UP_TO_1,
    at_least,
    check,
    one_of,
    optional,
)
from workbench.utils.errors import InputError


@pytest.mark.parametrize(
    ("expected", "inside", "outside"),
    [
        (POSITIVE, [1e-9, 1e9], [0.0, -1.0, np.inf]),
        (INSIDE_UNIT, [0.5], [0.0, 1.0]),
        (UNIT, [0.0, 1.0], [-0.1, 1.1]),
        (UP_TO_1, [0.1, 1.0], [0.0, 1.1]),
        (BELOW_1, [0.0, 0.9], [-0.1, 1.0]),
        (FINITE, [-1e9, 0.0], [np.inf, -np.inf]),
        (at_least(3), [3, 4.5], [2, np.inf]),
        (one_of("mean", "sum"), ["mean", "sum"], ["median"]),
        (optional(at_least(1)), [None, 1], [0, -1.0]),
    ],
)
def test_ranges_contain_their_values_and_never_nan(expected, inside, outside):
    assert all(expected.contains(value) for value in inside)
    assert not any(expected.contains(value) for value in [*outside, np.nan])


def test_the_first_attribute_out_of_range_is_named():
    component = SimpleNamespace(k=1.0, sigma=0.0, loss="cauchy")
    check("component", component, k=POSITIVE)
    with pytest.raises(InputError, match=r"component: sigma must be positive, found 0\.0"):
        check("component", component, k=POSITIVE, sigma=POSITIVE, loss=one_of("huber"))
    with pytest.raises(InputError, match="component: loss must be one of squared, huber, found 'cauchy'"):
        check("component", component, loss=one_of("squared", "huber"))
