"""The linear model of all motions and its postures: velocities there and back, and what regression recovers."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from workbench.body.shape import from_height
from workbench.body.skeleton import POSE_NAMES
from workbench.motion.models.linear_motion import (
    FRAMES_PER_COMPONENT,
    MIN_STD_RAD,
    N_POSE,
    POSTURE,
    integrated,
    learn_linear_motion,
    learn_pose_prior,
    maximisation_step,
    velocities,
)
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
    assert np.allclose(integrated(before, v, 30.0), after)
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
        poses.append(integrated(poses[-1], v, 30.0))
    return gain, np.array(poses)


def test_a_models_own_motion_is_learned_back():
    gain, poses = made_motion(20000, np.random.default_rng(0))
    model = learn_linear_motion([motion(poses)], 30.0)
    assert np.abs(model.gain - gain)[:, -N_POSE:].max() < 0.05  # of speeds; standard errors are about 0.005, ridge more
    assert np.allclose(np.sqrt(np.diag(model.covariance)), 0.3, rtol=0.03)
    assert np.all(np.diag(model.initial_covariance) >= np.diag(model.covariance) * 0.99)


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
    taken = learn_linear_motion([motion(poses)], 30.0).pose_prior
    assert taken is not None
    mean = np.zeros(N_POSE)
    mean[POSTURE] = taken.weights @ taken.means
    assert np.allclose(mean[[left, right, roll]], [0.5, 0.5, 0.0], atol=0.02)


def two_kinds(rng, n=1000):
    """Postures that are of one kind three times as often as of the other."""
    kinds = np.repeat([0, 1], [3 * n, n])
    means, deviations = np.array([[0.0, 0.0, 0.0], [1.0, -1.0, 0.5]]), np.array([[0.1, 0.2, 0.1], [0.3, 0.1, 0.1]])
    return means[kinds] + deviations[kinds] * rng.standard_normal((4 * n, 3))


def test_a_mixtures_own_postures_are_as_likely_as_by_what_made_them():
    model = learn_pose_prior(two_kinds(np.random.default_rng(0)))
    fresh = two_kinds(np.random.default_rng(1))
    near_second = np.linalg.norm(model.means - [1.0, -1.0, 0.5], axis=1) < np.linalg.norm(model.means, axis=1)
    assert abs(model.weights[near_second].sum() - 0.25) < 0.02  # 4000 draws: 0.007
    told = np.logaddexp.reduce(model.log_components(fresh), axis=1).mean()
    entropies = 0.5 * np.log(2.0 * np.pi * np.e * np.array([[0.1, 0.2, 0.1], [0.3, 0.1, 0.1]]) ** 2).sum(axis=1)
    exact = -entropies @ [0.75, 0.25] + np.array([0.75, 0.25]) @ np.log([0.75, 0.25])
    assert -0.2 < told - exact < 0.02  # 32 parts instead of 2, by 4000 draws


def test_a_part_that_few_were_in_is_nearly_as_wide_as_all_are():
    rng = np.random.default_rng(2)
    many, few = (
        rng.standard_normal((20 * FRAMES_PER_COMPONENT, 2)),
        5.0 + 1e-4 * rng.standard_normal((FRAMES_PER_COMPONENT, 2)),
    )
    kinds = np.repeat([0, 1], [len(many), len(few)])
    model = maximisation_step(np.concatenate([many, few]), np.eye(2)[kinds])
    common = 20.0 / 21.0 * many.var(axis=0)  # the others do not vary
    assert np.allclose(np.diag(model.covariances[1]), 0.5 * common + MIN_STD_RAD**2, rtol=1e-3)
    assert np.allclose(np.diag(model.covariances[0]), many.var(axis=0), rtol=5e-3)
    assert np.allclose(model.weights, [20.0 / 21.0, 1.0 / 21.0])


def test_the_same_postures_are_the_same_model_and_few_have_few_parts():
    postures = two_kinds(np.random.default_rng(3), 20)
    first, second = learn_pose_prior(postures), learn_pose_prior(postures)
    assert len(first.weights) == 80 // FRAMES_PER_COMPONENT
    assert np.array_equal(first.means, second.means)
    assert np.array_equal(first.covariances, second.covariances)
