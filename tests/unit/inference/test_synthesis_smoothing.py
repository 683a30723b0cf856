"""Smoothing: jumps are bounded and let go, motion without jumps passes."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from workbench.body.skeleton import POSE_NAMES
from workbench.inference.synthesis import Smoother

DT, TAU, LIMIT = 1 / 30, 0.1, 0.3
LET_GO = 1.0 - np.exp(-DT / TAU)


def poses_of(angle):
    poses = np.zeros((len(angle), len(POSE_NAMES)))
    poses[:, 10] = angle
    return poses


@settings(max_examples=50, deadline=None)
@given(st.integers(0, 2**32 - 1), st.floats(0.01, 3.0))
def test_no_angle_changes_by_more_than_the_limit_and_what_is_let_go(seed, size):
    poses = size * np.random.default_rng(seed).standard_normal((30, len(POSE_NAMES)))
    smoother, shown, offset = Smoother(TAU, LIMIT), None, np.zeros(len(POSE_NAMES) - 3)
    for pose in poses:
        now = smoother.follow(pose, DT)
        if shown is not None:
            assert (np.abs(now - shown)[3:] <= LIMIT + LET_GO * np.abs(offset) + 1e-9).all()
        turns = (now[3:] - smoother.offset - pose[3:]) / (2.0 * np.pi)
        assert turns == pytest.approx(np.rint(turns), abs=1e-9)  # the pose and the offset, but for whole turns
        assert (now[:3] == pose[:3]).all()
        shown, offset = now, smoother.offset.copy()


def test_a_jump_is_let_go_exponentially():
    jump = 2.0
    smoother = Smoother(TAU, LIMIT)
    shown = np.array([smoother.follow(pose, DT)[10] for pose in poses_of([0.0] + [jump] * 40)])
    left = (jump - LIMIT) * np.exp(-DT / TAU * np.arange(40))
    assert shown[1:] == pytest.approx(jump - left)


def test_motion_within_the_limit_passes_unchanged():
    poses = poses_of(np.cumsum(np.random.default_rng(0).uniform(-LIMIT, LIMIT, 60)))
    smoother = Smoother(TAU, LIMIT)
    assert np.array([smoother.follow(pose, DT) for pose in poses]) == pytest.approx(poses)


def test_a_whole_turn_is_no_jump():
    smoother = Smoother(TAU, LIMIT)
    shown = [smoother.follow(pose, DT)[10] for pose in poses_of([0.1, 0.2, 0.3 + 2.0 * np.pi, 0.4])]
    assert shown == pytest.approx([0.1, 0.2, 0.3, 0.4])


def test_without_smoothing_jumps_stay():
    poses = poses_of([0.0, 3.0, -3.0])
    smoother = Smoother(0.0, LIMIT)
    assert (np.array([smoother.follow(pose, DT) for pose in poses]) == poses).all()
