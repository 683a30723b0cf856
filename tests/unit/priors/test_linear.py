"""The linear prior: its samples, its density and its moments are those of one Gaussian."""

import numpy as np
import pytest

from workbench.body.skeleton import POSE_NAMES
from workbench.core.prior import RECORDED_SMOOTHNESS, Gaussian
from workbench.motion.models.linear_motion import N_POSE, LinearMotion
from workbench.priors.from_motions import linear
from workbench.priors.linear import Linear
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


def test_samples_have_the_stated_mean_and_covariance(prior):
    state = np.concatenate([np.full(N_POSE, 0.2), np.linspace(-1.0, 1.0, N_POSE)])
    state[3] = 1.0  # a heading away from x
    drawn = prior.sample_transition(np.repeat(state[None], 40000, axis=0), DT_S, np.random.default_rng(1))
    expected = prior.noise_covariance(state, DT_S)
    deviations = np.sqrt(np.diag(expected))
    assert np.abs((drawn.mean(axis=0) - prior.mean(state[None], DT_S)[0]) / deviations).max() < 5.0 / 200.0
    assert np.abs((np.cov(drawn.T) - expected) / np.outer(deviations, deviations)).max() < 0.03


def test_the_density_is_the_gaussian_of_the_poses(prior):
    rng = np.random.default_rng(2)
    before = prior.sample_initial(np.full(N_POSE, 0.1), 1, rng)
    drawn = prior.sample_transition(np.repeat(before, 6, axis=0), DT_S, rng)
    covariance = prior.noise_covariance(before[0], DT_S)[:N_POSE, :N_POSE]
    deviations = (drawn - prior.mean(before, DT_S))[:, :N_POSE]
    quadratic = np.einsum("np,np->n", deviations, np.linalg.solve(covariance, deviations.T).T)
    expected = -0.5 * (quadratic + np.linalg.slogdet(2.0 * np.pi * covariance)[1])
    assert np.allclose(prior.log_transition(before, drawn, DT_S), expected)
    assert np.allclose(prior.sample_dependent(np.repeat(before, 6, axis=0), drawn, DT_S, rng), drawn)


def test_initial_states_have_the_stated_moments(prior):
    pose = np.linspace(-0.1, 0.1, N_POSE)
    mean, covariance = prior.initial_moments(pose)
    drawn = prior.sample_initial(pose, 20000, np.random.default_rng(3))
    assert np.abs((drawn.mean(axis=0) - mean) / np.sqrt(np.diag(covariance))).max() < 5.0 / np.sqrt(20000)
    assert np.allclose(drawn.std(axis=0), np.sqrt(np.diag(covariance)), rtol=0.03)
    assert np.array_equal(mean[N_POSE:], np.ones(N_POSE))


def test_other_frame_rates_are_rejected(prior):
    assert isinstance(prior.capabilities.density, Gaussian)
    assert prior.parameters == POSE_NAMES
    with pytest.raises(InputError, match=r"learned at 30 Hz"):
        prior.sample_transition(
            prior.sample_initial(np.zeros(N_POSE), 2, np.random.default_rng(0)), 0.05, np.random.default_rng(0)
        )
    with pytest.raises(InputError, match="covers one frame"):
        prior.noise_covariance(np.zeros(2 * N_POSE), 2.0 * DT_S)
    with pytest.raises(InputError, match="noise_scale"):
        Linear(prior.model, noise_scale=0.0)


def test_generated_gaits_give_no_pose_prior(tmp_path):
    learned = linear(motions="builtin", cache=str(tmp_path)).capabilities
    assert learned.pose_prior is None
    assert learned.smoothness == RECORDED_SMOOTHNESS
