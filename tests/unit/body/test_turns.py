"""Whole turns change no pose; angles come to lie within half a turn of a reference."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from single_steps import SKELETON

from workbench.body.angles import _far, nearest_turn
from workbench.body.kinematics import joints

POSES = arrays(float, (3, 25), elements=st.floats(-400.0, 400.0))


@settings(deadline=None)  # the first call loads compiled kernels
@given(POSES, arrays(float, 25, elements=st.floats(-20.0, 20.0)))
def test_the_pose_stays_and_its_angles_come_near(poses, reference):
    moved = nearest_turn(poses, reference)
    assert np.abs(moved[:, 3:] - reference[3:]).max() <= np.pi + 1e-9
    assert (moved[:, :3] == poses[:, :3]).all()
    assert np.abs(joints(SKELETON, moved) - joints(SKELETON, poses)).max() < 1e-9


def test_what_is_near_is_returned_as_it_is():
    poses = np.random.default_rng(0).uniform(-3.0, 3.0, (5, 25))
    assert nearest_turn(poses, np.zeros(25)) is poses


@pytest.mark.parametrize("angle", [np.pi, np.nextafter(np.pi, 4.0), -np.pi, np.nextafter(-np.pi, -4.0), np.nan, np.inf])
def test_who_is_far_is_what_numpy_finds_of_every_angle(angle):
    poses = np.random.default_rng(0).uniform(-2.0, 2.0, (9, 25))
    poses[:, :3] = 100.0  # lengths have no turns
    poses[4, 7] = angle
    near = np.abs(poses[:, 3:] - np.zeros(22)) <= np.pi
    assert _far(poses, np.zeros(25))[3:].tolist() == (~near).sum(axis=0).tolist()
    assert _far(poses, np.zeros(25))[:3].tolist() == [0.0] * 3
