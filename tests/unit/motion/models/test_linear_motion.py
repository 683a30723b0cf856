"""The linear model of all motions: velocities there and back, and what regression recovers."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from workbench.body.shape import from_height
from workbench.body.skeleton import POSE_NAMES
from workbench.motion.models.linear_motion import N_POSE, POSTURE, learn_linear_motion, moved, velocities
from workbench.motion.pose_sequence import Motion
from workbench.utils.errors import InputError


def motion(poses, name="made up"):
    return Motion(name, "me", "?", 30.0, poses, from_height(1.7), np.zeros(14), "", "", "")


@given(st.integers(0, 1000), st.floats(-4.0, 4.0))
def test_velocities_lead_back_and_do_not_depend_on_where_one_is_and_faces(seed, turn):
    rng = np.random.default_rng(seed)
    before = rng.normal(size=N_POSE)
    after = before + 0.1 * rng.normal(size=N_POSE)
    v = velocities(before, after, 30.0)
    assert np.allclose(moved(before, v, 30.0), after)
    c, s = np.cos(turn), np.sin(turn)
    turned = [pose.copy() for pose in (before, after)]
    for pose in turned:
        pose[:2] = [c * pose[0] - s * pose[1] + 3.0, s * pose[0] + c * pose[1] - 1.0]
        pose[3] += turn
    assert np.allclose(velocities(*turned, 30.0), v)


def made_motion(n, rng):
    """Frames of a model whose gain and noise are known."""
    gain = np.concatenate([-0.5 * np.eye(N_POSE)[:, POSTURE], 0.8 * np.eye(N_POSE)], axis=1)
    gain[3] = 0.0
    poses, v = [np.zeros(N_POSE)], np.zeros(N_POSE)
    for _ in range(n):
        v = gain @ np.concatenate([poses[-1][POSTURE], v]) + 0.3 * rng.standard_normal(N_POSE)
        poses.append(moved(poses[-1], v, 30.0))
    return gain, np.array(poses)


def test_a_models_own_motion_is_learned_back():
    gain, poses = made_motion(20000, np.random.default_rng(0))
    model = learn_linear_motion([motion(poses)], 30.0)
    assert np.abs(model.gain - gain)[:, -N_POSE:].max() < 0.05  # of speeds; standard errors are about 0.005, ridge more
    assert np.allclose(np.sqrt(np.diag(model.covariance)), 0.3, rtol=0.03)
    assert np.all(np.diag(model.start_covariance) >= np.diag(model.covariance) * 0.99)


def test_what_starts_in_one_clip_does_not_go_on_in_the_next():
    _, poses = made_motion(400, np.random.default_rng(1))
    far = poses.copy()
    far[:, 0] += 100.0
    model = learn_linear_motion([motion(poses), motion(far, "elsewhere")], 30.0)
    assert np.sqrt(model.covariance[0, 0]) < 1.0  # m/s


def test_too_little_to_learn_from_is_said():
    with pytest.raises(InputError, match="some hundred frames"):
        learn_linear_motion([motion(np.zeros((20, len(POSE_NAMES))))], 30.0)


def test_postures_are_as_often_those_of_a_mirror():
    rng = np.random.default_rng(2)
    poses = 0.2 * rng.standard_normal((1200, N_POSE))
    left, right = (POSE_NAMES.index(f"{side}_elbow_flexion") for side in ("left", "right"))
    roll = POSE_NAMES.index("root_roll")
    poses[:, left], poses[:, roll] = poses[:, left] + 1.0, poses[:, roll] + 0.4  # one arm alone is bent, to one side
    taken = learn_linear_motion([motion(poses)], 30.0).postures
    assert taken is not None
    mean = np.zeros(N_POSE)
    mean[POSTURE] = taken.weights @ taken.means
    assert np.allclose(mean[[left, right, roll]], [0.5, 0.5, 0.0], atol=0.02)
