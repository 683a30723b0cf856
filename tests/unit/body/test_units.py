"""The unit of length by the size of a person or of a scene."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from workbench.body.units import PERSON_M, TYPICAL_M, UNITS, is_person, unit_of_extent, unit_of_person

METRIC = ("m", "cm", "mm")


@given(height_m=st.floats(0.71, 2.39), unit=st.sampled_from(METRIC))
def test_metric_units_follow_from_any_plausible_height(height_m, unit):
    assert unit_of_person(height_m / UNITS[unit], METRIC) == unit


@given(height=st.floats(1e-3, 1e6))
def test_the_unit_gives_a_plausible_height_next_to_a_typical_one(height):
    unit = unit_of_person(height)
    deviations = {name: abs(np.log(height * metres / TYPICAL_M)) for name, metres in UNITS.items()}
    if unit is None:
        assert not any(is_person(height * metres) for metres in UNITS.values())
    else:
        assert is_person(height * UNITS[unit])
        assert deviations[unit] == min(deviations[name] for name in UNITS if is_person(height * UNITS[name]))


@pytest.mark.parametrize(("height", "unit"), [(1.7, "m"), (170.0, "cm"), (67.0, "inch"), (30.0, "cmu"), (7.0, None)])
def test_units_of_persons(height, unit):
    assert unit_of_person(height) == unit
    assert PERSON_M[0] < TYPICAL_M < PERSON_M[1]


def test_the_unit_of_a_scene_is_the_first_whose_range_contains_its_extent():
    ranges = {"m": (0.0, 20.0), "mm": (3000.0, np.inf)}
    assert [unit_of_extent(extent, ranges) for extent in (20.0, 21.0, 3000.0)] == ["m", None, "mm"]
