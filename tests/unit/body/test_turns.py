"""Whole turns change no pose; angles come to lie within half a turn of a reference."""

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from single_steps import SKELETON

from workbench.body.angles import nearest_turn
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
