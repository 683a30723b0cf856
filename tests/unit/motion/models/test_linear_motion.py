"""The linear model of motions and the mixture of its postures: velocities, regression and expectation–maximization."""

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


def motion(poses, name="simulated"):
    return Motion(name, "me", "?", 30.0, poses, from_height(1.7), np.zeros(14), "", "", "")


@given(st.integers(0, 1000), st.floats(-4.0, 4.0))
def test_velocities_integrate_to_the_pose_and_do_not_depend_on_place_and_heading(seed, turn):
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


def simulated_motion(n, rng):
    """Return a gain and n frames that are simulated with it and with noise of 0.3."""
    gain = np.concatenate([-0.5 * np.eye(N_POSE)[:, POSTURE], 0.8 * np.eye(N_POSE)], axis=1)
    gain[3] = 0.0
    poses, v = [np.zeros(N_POSE)], np.zeros(N_POSE)
    for _ in range(n):
        v = gain @ np.concatenate([poses[-1][POSTURE], v]) + 0.3 * rng.standard_normal(N_POSE)
        poses.append(integrated(poses[-1], v, 30.0))
    return gain, np.array(poses)


def test_the_model_of_a_simulated_motion_is_recovered():
    gain, poses = simulated_motion(10000, np.random.default_rng(0))
    model = learn_linear_motion([motion(poses)], 30.0)
    assert np.abs(model.gain - gain)[:, -N_POSE:].max() < 0.05  # the standard errors are about 0.007
    assert np.allclose(np.sqrt(np.diag(model.covariance)), 0.3, rtol=0.03)
    assert np.all(np.diag(model.initial_covariance) >= np.diag(model.covariance) * 0.99)


def test_steps_from_one_clip_to_the_next_are_not_learned():
    _, poses = simulated_motion(400, np.random.default_rng(1))
    far = poses.copy()
    far[:, 0] += 100.0
    model = learn_linear_motion([motion(poses), motion(far, "elsewhere")], 30.0)
    assert np.sqrt(model.covariance[0, 0]) < 1.0  # m/s


def test_too_few_frames_are_rejected():
    with pytest.raises(InputError, match="some hundred frames"):
        learn_linear_motion([motion(np.zeros((20, len(POSE_NAMES))))], 30.0)


def test_postures_are_learned_with_their_mirror_images():
    rng = np.random.default_rng(2)
    poses = 0.2 * rng.standard_normal((1200, N_POSE))
    left, right = (POSE_NAMES.index(f"{side}_elbow_flexion") for side in ("left", "right"))
    roll = POSE_NAMES.index("root_roll")
    poses[:, left], poses[:, roll] = poses[:, left] + 1.0, poses[:, roll] + 0.4  # asymmetric
    pose_prior = learn_linear_motion([motion(poses)], 30.0).pose_prior
    assert pose_prior is not None
    mean = np.zeros(N_POSE)
    mean[POSTURE] = pose_prior.weights @ pose_prior.means
    assert np.allclose(mean[[left, right, roll]], [0.5, 0.5, 0.0], atol=0.02)


def two_components(rng, n=1000):
    """Return postures of two Gaussians with the weights 0.75 and 0.25."""
    components = np.repeat([0, 1], [3 * n, n])
    means, deviations = np.array([[0.0, 0.0, 0.0], [1.0, -1.0, 0.5]]), np.array([[0.1, 0.2, 0.1], [0.3, 0.1, 0.1]])
    return means[components] + deviations[components] * rng.standard_normal((4 * n, 3))


def test_the_mixtures_likelihood_is_that_of_the_true_distribution():
    model = learn_pose_prior(two_components(np.random.default_rng(0)))
    fresh = two_components(np.random.default_rng(1))
    near_second = np.linalg.norm(model.means - [1.0, -1.0, 0.5], axis=1) < np.linalg.norm(model.means, axis=1)
    assert abs(model.weights[near_second].sum() - 0.25) < 0.02  # 4000 draws: 0.007
    log_likelihood = np.logaddexp.reduce(model.log_components(fresh), axis=1).mean()
    entropies = 0.5 * np.log(2.0 * np.pi * np.e * np.array([[0.1, 0.2, 0.1], [0.3, 0.1, 0.1]]) ** 2).sum(axis=1)
    exact = -entropies @ [0.75, 0.25] + np.array([0.75, 0.25]) @ np.log([0.75, 0.25])
    assert -0.2 < log_likelihood - exact < 0.02  # 32 components instead of 2, from 4000 samples


def test_a_component_of_few_postures_is_shrunk_to_the_common_covariance():
    rng = np.random.default_rng(2)
    many = rng.standard_normal((20 * FRAMES_PER_COMPONENT, 2))
    few = 5.0 + 1e-4 * rng.standard_normal((FRAMES_PER_COMPONENT, 2))
    components = np.repeat([0, 1], [len(many), len(few)])
    model = maximisation_step(np.concatenate([many, few]), np.eye(2)[components])
    common = 20.0 / 21.0 * many.var(axis=0)  # the few do not vary
    assert np.allclose(np.diag(model.covariances[1]), 0.5 * common + MIN_STD_RAD**2, rtol=1e-3)
    assert np.allclose(np.diag(model.covariances[0]), many.var(axis=0), rtol=5e-3)
    assert np.allclose(model.weights, [20.0 / 21.0, 1.0 / 21.0])
