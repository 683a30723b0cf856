"""Foot contact: a planted ankle stays, a flying body is left alone, the ground is reached."""

import numpy as np
import pytest

from workbench.body.shape import from_height
from workbench.body.skeleton import POSE_NAMES, person_skeleton
from workbench.inference.synthesis import PLANTED_SPEED, SETTLE, FootContact, ankle_positions
from workbench.motion.synthetic.gait import builtin_motions

DT = 1 / 30


@pytest.fixture(scope="module")
def walk():
    return builtin_motions(n_subjects=1)[0].resampled(30.0)


def follow(skeleton, poses, ground_m):
    """The shifted poses (F, P), and which ankle is planted in each frame, -1 for none."""
    contact, shifted, planted = FootContact(skeleton, ground_m), [], []
    for pose in poses:
        shifted.append(contact.follow(pose, DT))
        planted.append(-1 if contact.planted is None else contact.planted)
    return np.array(shifted), np.array(planted)


def test_the_planted_ankle_stays_though_the_body_slides_and_sinks(walk):
    skeleton = person_skeleton(walk.shape)
    ground = ankle_positions(skeleton, walk.poses)[..., 2].min()
    sliding = walk.poses.copy()
    sliding[:, :3] += np.arange(len(walk))[:, None] * DT * [0.2, 0.1, -0.05]  # m/s
    shifted, planted = follow(skeleton, sliding, ground)
    assert (shifted[:, 3:] == sliding[:, 3:]).all()
    ankles = ankle_positions(skeleton, shifted)
    held = np.flatnonzero((planted[1:] == planted[:-1]) & (planted[1:] >= 0)) + 1
    assert len(held) > len(walk) / 3  # it walks: most of the time a foot is flat on the ground
    moved = ankles[held, planted[held]] - ankles[held - 1, planted[held]]
    assert np.abs(moved[:, :2]).max() < 1e-9  # held exactly, to rounding
    before = ankle_positions(skeleton, sliding)
    slid = before[held, planted[held]] - before[held - 1, planted[held]]
    assert np.abs(slid[:, :2]).max() > 0.2 * DT  # which is what it makes up for
    # Without contact the walk ends 30 cm below the ground.
    assert np.abs(ankles[held[-10:], planted[held[-10:]], 2] - ground).max() < 0.03


def test_a_standing_foot_settles_on_the_ground():
    skeleton = person_skeleton(from_height(1.75))
    poses = np.zeros((6, len(POSE_NAMES)))
    height = ankle_positions(skeleton, poses[:1])[0, 0, 2]
    shifted, planted = follow(skeleton, poses, height - 0.08)
    assert planted[0] == -1  # a first pose has no speed
    assert (planted[1:] >= 0).all()
    above = ankle_positions(skeleton, shifted)[:, 0, 2] - (height - 0.08)
    assert above == pytest.approx(0.08 * (1.0 - SETTLE) ** np.arange(6))


def test_a_body_in_flight_and_a_slow_foot_high_up_are_left_alone():
    skeleton = person_skeleton(from_height(1.75))
    flight = np.zeros((10, len(POSE_NAMES)))
    flight[:, 0] = np.arange(10) * DT * 1.01 * PLANTED_SPEED
    hanging = np.zeros((10, len(POSE_NAMES)))
    ground = ankle_positions(skeleton, hanging[:1])[0, 0, 2]
    for poses, below in ((flight, 0.0), (hanging, 1.0)):
        shifted, planted = follow(skeleton, poses, ground - below)
        assert (planted == -1).all()
        assert (shifted == poses).all()


def test_landing_and_taking_off_make_no_jump(walk):
    skeleton = person_skeleton(walk.shape)
    ground = ankle_positions(skeleton, walk.poses)[..., 2].min()
    shifted, planted = follow(skeleton, walk.poses, ground)
    assert set(planted) == {-1, 0, 1}
    shift = np.diff(shifted[:, :3] - walk.poses[:, :3], axis=0)
    # In a frame the shift makes up for at most a slow ankle's way, and half of what is missing to the ground.
    assert np.linalg.norm(shift[:, :2], axis=1).max() <= PLANTED_SPEED * DT + 1e-12
    assert np.abs(shift[planted[1:] == -1]).max() < 1e-12
