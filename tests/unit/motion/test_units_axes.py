"""Unit and vertical axis of a file by its header and a person's size and posture."""

import logging

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from workbench.body.kinematics import joints
from workbench.body.shape import from_height
from workbench.body.skeleton import JOINT_NAMES, person_skeleton
from workbench.body.stature import stature
from workbench.body.units import UNITS
from workbench.motion.formats.units_axes import AXES, metres_per_unit, upward, vertical_axis, world_axes
from workbench.utils.errors import InputError

PAIRS = [(up, forward) for up in AXES for forward in (None, *AXES) if forward is None or forward[-1] != up[-1]]


@pytest.mark.parametrize(("up", "forward"), PAIRS)
def test_axes_are_a_rotation_to_the_world(up, forward):
    axes = world_axes(up, forward)
    matrix = axes.vectors(np.eye(3)).T
    assert np.linalg.det(matrix) == pytest.approx(1.0)
    for axis, world in ((up, [0, 0, 1]), (forward, [1, 0, 0])):
        if axis is not None:
            vector = np.eye(3)["xyz".index(axis[-1])] * (-1.0 if axis[0] == "-" else 1.0)
            np.testing.assert_array_equal(axes.vectors(vector), world)
    rotation = np.random.default_rng(0).normal(size=(4, 3, 3))
    np.testing.assert_allclose(axes.rotations(rotation), matrix @ rotation @ matrix.T)


def test_files_with_y_up_and_z_up():
    np.testing.assert_array_equal(world_axes("y").vectors(np.array([1.0, 2.0, 3.0])), [3.0, 1.0, 2.0])
    np.testing.assert_array_equal(world_axes("z").vectors(np.array([1.0, 2.0, 3.0])), [1.0, 2.0, 3.0])
    for wrong in (("w", None), ("y", "-y"), ("", None)):
        with pytest.raises(InputError, match="two different axes"):
            world_axes(*wrong)


@settings(max_examples=30)
@given(height_m=st.floats(0.86, 2.39), unit=st.sampled_from(list(UNITS)))
def test_height_and_vertical_axis_follow_from_a_standing_person(height_m, unit):
    skeleton = person_skeleton(from_height(height_m))
    positions = joints(skeleton, np.zeros((3, 25))) / UNITS[unit]
    by_name = {name: positions[:, k] for k, name in enumerate(JOINT_NAMES)}
    assert stature(by_name) == pytest.approx(height_m / UNITS[unit])
    assert metres_per_unit("file", stature(by_name), unit) == UNITS[unit]
    assert vertical_axis("file", upward(by_name), None) == "z"
    legs = {name: position for name, position in by_name.items() if "knee" in name or "hip" in name}
    assert vertical_axis("file", upward(legs), None) == "z"
    assert stature({}) is None
    assert upward({"left_knee": positions[:, 1]}) is None


@pytest.mark.parametrize(
    ("size", "header", "metres", "level"),
    [
        (1.7, "m", 1.0, logging.INFO), (170.0, "Centimeters", 0.01, logging.INFO), (1700.0, "mm", 0.001, logging.INFO),
        (67.0, "inches", 0.0254, logging.INFO), (1.7, 1.0, 1.0, logging.INFO), (1700.0, "m", 0.001, logging.WARNING),
        (67.0, "cm", 0.0254, logging.WARNING), (30.0, "cm", UNITS["cmu"], logging.WARNING),
        (1.7, "furlong", 1.0, logging.WARNING), (170.0, "", 0.01, logging.INFO), (None, "cm", 0.01, logging.INFO),
        (None, "", 1.0, logging.INFO), (75.0, "cm", 0.0254, logging.WARNING), (0.75, "m", 1.0, logging.INFO),
    ],
)  # fmt: skip
def test_the_header_is_used_where_it_is_plausible(caplog, size, header, metres, level):
    caplog.set_level(logging.INFO)
    assert metres_per_unit("file", size, header) == metres
    assert [record.levelno for record in caplog.records] == [level]


@pytest.mark.parametrize(("size", "metres"), [(44.9, UNITS["inch"]), (45.1, 0.01), (62.0, 0.01)])
def test_a_stated_unit_of_a_child_is_used(size, metres):
    assert metres_per_unit("file", size, "cm", is_stated=True) == metres


def test_an_implausible_size_and_an_unknown_unit_are_rejected():
    with pytest.raises(InputError, match=r"file: expected a person of 0.45 to 2.4 m, found a body height of 1.7e\+05"):
        metres_per_unit("file", 170_000.0, "mm")
    with pytest.raises(InputError, match="the unit must be one of m, cm, mm, inch, cmu, found 'ell'"):
        metres_per_unit("file", 1.7, "m", "ell")
    assert metres_per_unit("file", 170_000.0, "mm", "mm") == 0.001


def along(axis, fraction=1.0, n=20):
    """Return n vectors, a fraction of which are along an axis and the others oblique; the last is NaN."""
    vectors = np.tile(np.eye(3)["xyz".index(axis[-1])] * (-1.7 if axis[0] == "-" else 1.7), (n, 1))
    vectors[: round((1.0 - fraction) * n)] = 1.0
    vectors[-1] = np.nan
    return vectors


@pytest.mark.parametrize(
    ("axis", "fraction", "default", "expected"),
    [
        ("y", 1.0, "y", "y"), ("y", 0.6, "y", "y"), ("z", 1.0, "y", "z"), ("z", 0.5, "y", "y"), ("-y", 1.0, "y", "-y"),
        ("y", 1.0, None, "y"), ("z", 0.6, None, "z"), ("-z", 1.0, None, "-z"), ("x", 0.5, "y", "y"),
        ("x", 1.0, "y", None), ("-x", 1.0, None, None), ("z", 0.3, None, None), ("x", 1.0, "x", "x"),
    ],
)  # fmt: skip
def test_the_vertical_axis_is_that_of_most_frames_or_the_default(axis, fraction, default, expected):
    if expected is None:
        with pytest.raises(InputError, match="if the person lies, give the vertical axis"):
            vertical_axis("file", along(axis, fraction), default)
    else:
        assert vertical_axis("file", along(axis, fraction), default) == expected
    assert vertical_axis("file", along(axis, fraction), default, "-x") == "-x"


def test_an_unknown_posture_needs_a_default_axis():
    assert vertical_axis("file", None, "y") == "y"
    with pytest.raises(InputError, match="expected joints or markers of head or shoulders"):
        vertical_axis("file", None, None)
    with pytest.raises(InputError, match="the vertical axis must be one of"):
        vertical_axis("file", None, "y", "up")
