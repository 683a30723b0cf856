"""The cyclic prior: decoding against NumPy, transitions against their moments, derivatives against differences."""

import numpy as np
import pytest
import scipy

from tests.oracles import cyclic as oracle
from workbench.body.kinematics import forward
from workbench.body.shape import from_height
from workbench.body.skeleton import N_ROOT, person_skeleton
from workbench.cameras.camera import plain_camera
from workbench.core.residual import projection_jacobian
from workbench.motion.models.walking import WalkingModel
from workbench.priors.cyclic import TABLE_PHASES, Cyclic, at_table_phases, decode

T, D = 32, 3


def model(seed=0, channels=20):
    """Smooth random curves: a few harmonics over a plausible mean walk; 25 channels include the root's sway."""
    rng = np.random.default_rng(seed)
    phase = 2 * np.pi * np.arange(T) / T
    waves = np.stack([np.cos(phase), np.sin(phase), np.cos(2 * phase), np.sin(2 * phase)])
    mean = 0.3 * np.einsum("ht,hc->tc", waves, rng.normal(size=(4, channels))) + 0.2
    mean[:, 0] += 1.1
    components = np.einsum("ht,dhc->dtc", waves, rng.normal(size=(D, 4, channels)))
    components /= np.linalg.norm(components, axis=(1, 2), keepdims=True)
    return WalkingModel(mean, components, np.array([1.5, 1.0, 0.5]), (0.95, 0.08), 0.9, 20)


def states(prior, n, seed=1):
    state = np.random.default_rng(seed).normal(size=(n, len(prior.space)))
    state[:, prior.space.slices["phase"]] %= 1.0
    return state


@pytest.mark.parametrize("n_phases", [33, 64, TABLE_PHASES])
def test_curves_are_resampled_as_by_scipy(n_phases):
    curves = np.random.default_rng(0).standard_normal((3, n_phases, 4))
    np.testing.assert_array_equal(at_table_phases(curves), scipy.signal.resample(curves, TABLE_PHASES, axis=1))


def test_the_kernel_agrees_with_numpy():
    rng = np.random.default_rng(0)
    table, coefficients = rng.normal(size=(16, 1 + D, 20)), rng.normal(size=(200, D))
    phase = np.concatenate([rng.uniform(-2, 3, 196), [0.0, 1.0, 1.0 - 1e-16, -1e-18]])
    assert decode(table, coefficients, phase) == pytest.approx(oracle.decode(table, coefficients, phase), abs=1e-12)


def test_decoding_at_the_models_phases_gives_its_curves():
    learned = model()
    prior = Cyclic(learned)
    state = np.zeros((T, len(prior.space)))
    state[:, prior.space.slices["phase"]] = (np.arange(T) / T)[:, None]
    state[:, prior.space.slices["coefficients"]] = (c := np.array([0.5, -1.0, 2.0]))
    expected = learned.mean + np.einsum("d,dtc->tc", c * learned.scales, learned.components)
    assert prior.pose(state)[:, N_ROOT:] == pytest.approx(expected[:, 1:], abs=1e-9)


def test_initial_states_are_near_the_pose(monkeypatch):
    for name in ("COEFFICIENT", "PHASE"):
        monkeypatch.setattr(f"workbench.priors.cyclic.INITIAL_{name}_STD", 0.0)
    prior = Cyclic(model(), initial_position_std=0.01, initial_rotation_std=0.02)
    true = states(prior, 1)
    true[0, prior.space.slices["coefficients"]] = [0.4, -0.3, 0.2]
    pose = prior.pose(true)[0]
    start = prior.sample_initial(pose, 2000, np.random.default_rng(0))
    poses = prior.pose(start)
    assert poses[:, :3].std(axis=0) == pytest.approx(0.01, rel=0.1)
    assert poses[:, 3:6].std(axis=0) == pytest.approx(0.02, rel=0.1)
    # the ridge towards the mean biases the angles by less than the 0.1 rad that it assumes
    assert np.abs(poses[:, N_ROOT:].mean(axis=0) - pose[N_ROOT:]).max() < 0.1
    speed = start[:, prior.space.slices["phase_speed"]]
    assert (speed.mean(), speed.std()) == (pytest.approx(0.95, abs=0.01), pytest.approx(0.08, rel=0.1))


def test_the_root_sways_across_its_mean_heading():
    prior = Cyclic(model(channels=25))
    state = states(prior, 1)
    state[0, prior.space.slices["coefficients"]] = 0.0
    state[0, prior.space.slices["phase"]] = 0.25
    sway, up, *turns = prior.model.mean[T // 4, 20:]
    pose, root = prior.pose(state)[0], state[0, -6:]
    across = np.array([-np.sin(root[3]), np.cos(root[3])])
    expected = np.concatenate([root[:2] + sway * across, [root[2] + up], root[3:] + turns])
    assert pose[:N_ROOT] == pytest.approx(expected, abs=1e-12)
    # the nearest state may have another phase and coefficients, but its pose has the same root
    assert prior.pose(prior.nearest(pose)[None])[0, :N_ROOT] == pytest.approx(pose[:N_ROOT], abs=1e-12)


@pytest.mark.parametrize("dt_s", [1 / 30, 1 / 120])
def test_one_step_has_the_stated_mean_and_deviation(dt_s):
    prior = Cyclic(model(), sigma_position=(0.01, 0.02, 0.03), sigma_rotation=(0.02, 0.01, 0.03))
    parent = states(prior, 1)
    parent[0, prior.space.slices["phase"]] = 0.3
    parents = np.repeat(parent, 40000, axis=0)
    steps = prior.sample_transition(parents, dt_s, np.random.default_rng(0)) - parent
    slices, n_frames = prior.space.slices, dt_s * 30
    deviations = np.array([0.05] * D + [0.009, 0.01, 0.01, 0.02, 0.03, 0.02, 0.01, 0.03]) * np.sqrt(n_frames)
    assert steps.std(axis=0) == pytest.approx(deviations, rel=0.03)
    speed = decode(prior._table, parent[:, slices["coefficients"]], parent[0, slices["phase"]])[0, 0]
    heading = parent[0, slices["root_rotation"].start]
    mean = np.zeros(len(prior.space))
    mean[slices["coefficients"]] = -(1 - np.sqrt(1 - n_frames * 0.05**2)) * parent[0, slices["coefficients"]]
    mean[slices["phase"]] = dt_s * parent[0, slices["phase_speed"]]
    mean[slices["root_position"]] = dt_s * speed * np.array([np.cos(heading), np.sin(heading), 0.0])
    assert steps.mean(axis=0) == pytest.approx(mean, abs=5 * deviations.max() / np.sqrt(40000))


NO_ROOT_NOISE = {
    "sigma_phase": 0.0,
    "sigma_phase_speed": 0.0,
    "sigma_position": (0.0,) * 3,
    "sigma_rotation": (0.0,) * 3,
}


def test_as_in_paper_a_the_coefficients_are_a_random_walk():
    """The state has d + 1 + 3 + 3 numbers (A, section 6.2). After n steps the coefficients are N(0, n ε²)."""
    prior = Cyclic(model(), transition="A", sigma_coefficients=0.2, **NO_ROOT_NOISE)
    assert len(prior.space) == D + 7
    assert "phase_speed" not in prior.space.slices
    state, rng = np.zeros((4000, len(prior.space))), np.random.default_rng(0)
    for _ in range(100):
        state = prior.sample_transition(state, 1 / 30, rng)
    assert state[:, prior.space.slices["coefficients"]].std(axis=0) == pytest.approx(0.2 * 10.0, rel=0.04)
    phase = 0.95 * 100 / 30 % 1.0  # by the mean rate of the training cycles
    assert state[:, prior.space.slices["phase"]] == pytest.approx(phase, abs=1e-9)


def test_as_in_paper_a_the_root_moves_along_the_torsos_axis():
    prior = Cyclic(model(), transition="A", sigma_coefficients=0.0, **NO_ROOT_NOISE)
    state = states(prior, 5)
    moved = prior.sample_transition(state, 0.1, np.random.default_rng(0))
    pose = np.zeros((5, 25))
    pose[:, :N_ROOT] = state[:, -N_ROOT:]
    torso = forward(person_skeleton(from_height(1.75)), pose).rotations[:, 0]
    speed = decode(prior._table, state[:, :D], state[:, D])[:, 0]
    position = prior.space.slices["root_position"]
    assert moved[:, position] - state[:, position] == pytest.approx(0.1 * speed[:, None] * torso[:, :, 0], abs=1e-12)


def test_as_in_paper_b_the_root_has_no_mean_motion():
    prior = Cyclic(model(), transition="B", sigma_coefficients=0.0, **NO_ROOT_NOISE)
    state = states(prior, 5)
    moved = prior.sample_transition(state, 0.1, np.random.default_rng(0))
    phase, cycles_hz = (state[:, prior.space.slices[name]] for name in ("phase", "phase_speed"))
    expected = state.copy()
    expected[:, prior.space.slices["phase"]] = (phase + 0.1 * cycles_hz) % 1.0
    assert moved == pytest.approx(expected, abs=1e-12)


@pytest.mark.parametrize("transition", ["A", "B"])
def test_initial_states_of_the_papers_are_near_the_pose(transition):
    prior = Cyclic(model(), transition=transition)
    pose = prior.pose(0.1 * states(prior, 1))[0]
    start = prior.pose(prior.sample_initial(pose, 500, np.random.default_rng(0)))
    assert start[:, :3].mean(axis=0) == pytest.approx(pose[:3], abs=0.005)
    assert start[:, :3].std(axis=0) == pytest.approx(0.01, rel=0.15)


@pytest.mark.parametrize("dt_s", [1 / 30, 1 / 10])
def test_coefficients_stay_standard_normal(dt_s):
    prior, rng = Cyclic(model(), sigma_coefficients=0.5), np.random.default_rng(0)
    state, columns = np.zeros((10_000, len(prior.space))), prior.space.slices["coefficients"]
    state[:, columns] = rng.standard_normal((10_000, D))
    moved = prior.sample_transition(state, dt_s, rng)[:, columns]
    assert moved.std(axis=0) == pytest.approx(1.0, rel=5 / np.sqrt(2 * 10_000))
    assert prior.mean(state, dt_s)[:, columns] == pytest.approx(np.sqrt(1.0 - 30.0 * dt_s * 0.25) * state[:, columns])


def test_the_root_moves_at_the_torso_speed_of_the_previous_phase():
    """The position τ_t follows from τ_t−1 and v_t−1 (A, eq. 16); a quarter of a cycle later the speed differs."""
    learned, c = model(), np.array([0.5, -1.0, 0.3])
    prior = Cyclic(learned)
    slices, state = prior.space.slices, np.zeros((1, len(prior.space)))
    state[0, slices["coefficients"]], state[0, slices["phase"]], state[0, slices["phase_speed"]] = c, 5 / T, 2.0
    speeds = learned.mean[:, 0] + np.einsum("d,dt->t", c * learned.scales, learned.components[:, :, 0])
    moved = prior.mean(state, 0.125)
    assert abs(speeds[5 + T // 4] - speeds[5]) > 0.05
    assert moved[0, slices["phase"]] == pytest.approx(5 / T + 0.25)
    assert moved[0, slices["root_position"]] == pytest.approx([0.125 * speeds[5], 0.0, 0.0], abs=1e-9)


CAMERA = plain_camera(640, 480, 700.0, (0.3, -4.5, 1.2), (0.0, 0.0, 1.0))


def test_the_projection_jacobian_agrees_with_finite_differences():
    points = np.random.default_rng(0).normal([0, 0, 1], 0.4, (10, 3))
    analytic = projection_jacobian(CAMERA, points)
    for axis in range(3):
        shift = 1e-6 * np.eye(3)[axis]
        numeric = (CAMERA.project(points + shift) - CAMERA.project(points - shift)) / 2e-6
        assert analytic[:, :, axis] == pytest.approx(numeric, rel=1e-6, abs=1e-5)
