"""The linear prior: its samples and its density are those of one Gaussian."""

import numpy as np
import pytest

from workbench.body.skeleton import POSE_NAMES
from workbench.core.prior import RECORDED_SMOOTHNESS
from workbench.motion.models.linear_motion import N_POSE, LinearMotion
from workbench.priors.from_motions import linear
from workbench.priors.linear import INITIAL_ANGLE_STD, INITIAL_POSITION_STD, Linear
from workbench.utils.errors import InputError

DT_S = 1.0 / 30.0


@pytest.fixture(scope="module")
def prior():
    rng = np.random.default_rng(0)
    gain = np.concatenate([np.zeros((N_POSE, N_POSE - 4)), 0.9 * np.eye(N_POSE)], axis=1)
    mixed = 0.3 * rng.standard_normal((N_POSE, N_POSE))
    covariance = mixed @ mixed.T + 0.1 * np.eye(N_POSE)
    still = np.zeros((N_POSE, N_POSE - 4))
    return Linear(
        LinearMotion(30.0, gain, np.zeros(N_POSE), covariance, still, np.ones(N_POSE), covariance), noise_scale=2.0
    )


def noise_covariance(prior, state):
    """Return the covariance (50, 50) of a state (50,) one frame later: of the velocities' noise, integrated once."""
    integration = np.eye(N_POSE)
    c, s = np.cos(state[3]), np.sin(state[3])
    integration[:2, :2] = np.array([[c, -s], [s, c]])  # the root's velocity is in the heading frame
    root = np.concatenate([DT_S * integration, np.eye(N_POSE)]) @ np.linalg.cholesky(prior.model.covariance)
    return prior.noise_scale**2 * root @ root.T


def test_samples_have_the_stated_mean_and_covariance(prior):
    state = np.concatenate([np.full(N_POSE, 0.2), np.linspace(-1.0, 1.0, N_POSE)])
    state[3] = 1.0  # a heading away from x
    drawn = prior.sample_transition(np.repeat(state[None], 40000, axis=0), DT_S, np.random.default_rng(1))
    expected = noise_covariance(prior, state)
    deviations = np.sqrt(np.diag(expected))
    assert np.abs((drawn.mean(axis=0) - prior.mean(state[None], DT_S)[0]) / deviations).max() < 5.0 / 200.0
    assert np.abs((np.cov(drawn.T) - expected) / np.outer(deviations, deviations)).max() < 0.03


def test_the_density_is_the_gaussian_of_the_poses(prior):
    rng = np.random.default_rng(2)
    before = prior.sample_initial(np.full(N_POSE, 0.1), 1, rng)
    drawn = prior.sample_transition(np.repeat(before, 6, axis=0), DT_S, rng)
    covariance = noise_covariance(prior, before[0])[:N_POSE, :N_POSE]
    deviations = (drawn - prior.mean(before, DT_S))[:, :N_POSE]
    quadratic = np.einsum("np,np->n", deviations, np.linalg.solve(covariance, deviations.T).T)
    expected = -0.5 * (quadratic + np.linalg.slogdet(2.0 * np.pi * covariance)[1])
    assert np.allclose(prior.log_transition(before, drawn, DT_S), expected)
    assert np.allclose(prior.sample_dependent(np.repeat(before, 6, axis=0), drawn, DT_S, rng), drawn)


def test_initial_states_have_the_stated_moments(prior):
    pose = np.linspace(-0.1, 0.1, N_POSE)
    mean = np.concatenate([pose, np.ones(N_POSE)])
    pose_std = np.repeat([INITIAL_POSITION_STD, INITIAL_ANGLE_STD], [3, N_POSE - 3])
    deviations = np.concatenate([pose_std, np.sqrt(np.diag(prior.model.initial_covariance))])
    drawn = prior.sample_initial(pose, 20000, np.random.default_rng(3))
    assert np.abs((drawn.mean(axis=0) - mean) / deviations).max() < 5.0 / np.sqrt(20000)
    assert np.allclose(drawn.std(axis=0), deviations, rtol=0.03)


def test_other_frame_rates_are_rejected(prior):
    assert prior.parameters == POSE_NAMES
    with pytest.raises(InputError, match=r"learned at 30 Hz"):
        prior.sample_transition(
            prior.sample_initial(np.zeros(N_POSE), 2, np.random.default_rng(0)), 0.05, np.random.default_rng(0)
        )
    with pytest.raises(InputError, match="covers one frame"):
        prior.log_transition(np.zeros(2 * N_POSE), np.zeros(2 * N_POSE), 2.0 * DT_S)
    with pytest.raises(InputError, match="noise_scale"):
        Linear(prior.model, noise_scale=0.0)


def test_generated_gaits_give_no_pose_prior(tmp_path):
    learned = linear(motions="builtin", cache=str(tmp_path)).capabilities
    assert learned.pose_prior is None
    assert learned.smoothness == RECORDED_SMOOTHNESS


def test_knees_change_faster_than_necks_on_both_sides():
    knees = [RECORDED_SMOOTHNESS.of_angle(f"{side}_knee_flexion") for side in ("left", "right")]
    assert knees[0] == knees[1] > 3.0 * RECORDED_SMOOTHNESS.of_angle("neck_turn")
    assert RECORDED_SMOOTHNESS.of_angle("left_ankle_flexion") == RECORDED_SMOOTHNESS.angle
