"""The activity prior: its poses, its transitions and its initial states."""

import numpy as np
import pytest

from workbench.body.skeleton import N_ROOT, POSE_NAMES
from workbench.motion.models.training import activity_model
from workbench.priors.activity import Activity

DT = 1 / 14


@pytest.fixture(scope="module")
def model(cache):
    return activity_model(cache=str(cache), n_components=3)


def states(prior, n, seed=0):
    rng = np.random.default_rng(seed)
    state = rng.standard_normal((n, len(prior.space)))
    state[:, prior.space.slices["phase"]] = rng.random((n, 1))
    return state


def test_poses_have_the_models_angles_and_the_states_root(model):
    prior = Activity(model)
    state = states(prior, 5)
    poses = prior.pose(state)
    slices = prior.space.slices
    np.testing.assert_array_equal(poses[:, :3], state[:, slices["root_position"]])
    np.testing.assert_array_equal(poses[:, 3:N_ROOT], state[:, slices["root_rotation"]])
    columns = [POSE_NAMES.index(name) for name in model.angles]
    for k in range(5):
        expected = model.angles_at(state[k, slices["coefficients"]], state[k, slices["phase"]][0])
        np.testing.assert_allclose(poses[k, columns], expected, rtol=1e-12)


def test_without_noise_phase_and_root_advance_at_their_velocities(model):
    prior = Activity(
        model, sigma_coefficients=0.0, sigma_phase=0.0, sigma_phase_speed=0.0, sigma_position=0.0,
        sigma_rotation=(0.0, 0.0, 0.0), sigma_velocity=0.0,
    )  # fmt: skip
    state = states(prior, 6)
    moved = prior.sample_transition(state, DT, np.random.default_rng(1))
    slices = prior.space.slices
    expected = state.copy()
    expected[:, slices["phase"]] = (state[:, slices["phase"]] + DT * state[:, slices["phase_speed"]]) % 1.0
    expected[:, slices["root_position"]] += DT * state[:, slices["root_velocity"]]
    np.testing.assert_allclose(moved, expected, atol=1e-15)


def test_coefficients_stay_standard_normal(model):
    """By x' = a x + b n with a² = 1 − s² and b² = s² per frame, the variance stays one."""
    prior = Activity(model, sigma_coefficients=0.4)
    rng = np.random.default_rng(2)
    state = states(prior, 10_000, seed=3)
    for _ in range(5):
        state = prior.sample_transition(state, 1 / 30, rng)
    variance = state[:, prior.space.slices["coefficients"]].var(axis=0)
    assert variance == pytest.approx(1.0, abs=5 * np.sqrt(2 / 10_000))


def test_the_nearest_state_has_the_smallest_cost(model):
    prior = Activity(model)
    truth = states(prior, 1, seed=4)[0]
    pose = prior.pose(truth[None])[0]
    nearest = prior.nearest(pose)

    def cost(state):
        """Return what `nearest` minimizes: squared angles in units of 0.1 rad and squared coefficients."""
        residuals = (prior.pose(state[None])[0] - pose)[N_ROOT:] / 0.1
        return (residuals**2).sum() + (state[prior.space.slices["coefficients"]] ** 2).sum()

    rounded = truth.copy()  # the truth at the nearest of the phases tried is one candidate
    rounded[prior.space.slices["phase"]] = np.round(truth[prior.space.slices["phase"]] * 64) / 64
    assert cost(nearest) <= cost(rounded) + 1e-9
    assert cost(nearest) < 0.1 * cost(prior.nearest(np.zeros(len(POSE_NAMES))))
    initial = prior.sample_initial(pose, 2000, np.random.default_rng(5))
    assert np.abs(prior.pose(initial).mean(axis=0)[:3] - pose[:3]).max() < 5 * 0.02 / np.sqrt(2000)
    assert set(np.unique(initial[:, prior.space.slices["phase_speed"]])) <= set(model.cycle_rate_hz)
