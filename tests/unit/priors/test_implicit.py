"""The implicit prior: predictions against the database, noise, initial states and frame rates."""

import numpy as np
import pytest

from workbench.body.skeleton import N_ROOT, PARTS, POSE_NAMES
from workbench.motion.models.windows import learn_windows
from workbench.motion.synthetic.gait import builtin_motions
from workbench.priors.implicit import Implicit
from workbench.utils.errors import InputError

NO_NOISE = {"sigma_position": (0.0,) * 3, "sigma_rotation": (0.0,) * 3, "sigma_angles": 0.0}
NEAREST_ENTRY = {"beta": 1e-6, **NO_NOISE}  # so cold that a window of the database has the probability one
DT, N = 1 / 30, 5000


@pytest.fixture(scope="module")
def motions():
    return builtin_motions(n_subjects=4)


@pytest.fixture(scope="module")
def windows(motions):
    return learn_windows(motions)


@pytest.fixture(scope="module")
def poses(motions):
    return motions[1].resampled(30.0).poses


@pytest.mark.parametrize("prediction", ["copy", "increment", "blend"])
def test_a_known_motion_is_replayed(windows, poses, prediction):
    """From a window of the database, without noise, every prediction is the recorded continuation."""
    prior = Implicit(windows, prediction=prediction, **NEAREST_ENTRY)
    state, rng = prior.start_after(poses[20:31], 3), np.random.default_rng(0)
    for k in range(31, 60):
        state = prior.sample_transition(state, DT, rng)
        assert prior.pose(state) == pytest.approx(np.repeat(poses[k : k + 1], 3, axis=0), abs=1e-4)  # float32 rows


def test_predictions_follow_their_definitions(windows, poses):
    """Copy gives ψ_{i+1}, increment adds ψ_{i+1} − ψ_i, and blend also a quarter of the difference to ψ_i."""
    entries, offset = np.array([40, 90]), 0.2
    rows = windows.rows.astype(np.float64)
    before, after = (rows[windows.ends[entries] + k][:, : len(PARTS["body"])] for k in (0, 1))
    expected = {"copy": after, "increment": after - before, "blend": after - before}
    for prediction, target in expected.items():
        prior = Implicit(windows, prediction=prediction, blend_rate=0.25, **NO_NOISE)
        state = prior.start_after(poses[20:31] + offset, 2)
        now = state[:, N_ROOT : len(POSE_NAMES)]
        moved = prior.predict(state, entries, np.zeros((2, len(POSE_NAMES))))[:, N_ROOT : len(POSE_NAMES)]
        if prediction == "increment":
            target = now + target
        if prediction == "blend":
            target = now + target + 0.25 * (before - now)
        assert moved == pytest.approx(target, abs=1e-9)


def test_the_window_of_a_state_is_its_motion(windows, poses):
    """After d steps without noise the coefficients are those of the particle's d poses."""
    prior, rng = Implicit(windows, prediction="increment", beta=0.5, **NO_NOISE), np.random.default_rng(1)
    state = prior.start_after(poses[20:31], 5)
    track = [prior.pose(state)]
    for _ in range(windows.window_frames):
        state = prior.sample_transition(state, DT, rng)
        track.append(prior.pose(state))
    b = len(windows.sigmas)
    for particle in range(5):
        expected = prior.start_after(np.array([step[particle] for step in track]), 1)
        coefficients = state[particle, prior.space.slices["coefficients"]]
        assert coefficients == pytest.approx(expected[0, len(POSE_NAMES) : len(POSE_NAMES) + b], abs=1e-4)


@pytest.mark.parametrize("rate_hz", [15.0, 30.0])
def test_noise_has_the_stated_deviations_for_a_thirtieth_of_a_second(motions, poses, rate_hz):
    sigmas = {"sigma_position": (0.01, 0.02, 0.03), "sigma_rotation": (0.02, 0.01, 0.03), "sigma_angles": 0.05}
    prior = Implicit(learn_windows(motions, rate_hz=rate_hz), beta=1e-6, **sigmas)
    state = prior.sample_transition(prior.start_after(poses[20:31], N), 1 / rate_hz, np.random.default_rng(0))
    spread = prior.pose(state).std(axis=0) / np.sqrt(30.0 / rate_hz)
    c, s = np.cos(poses[30, 3]), np.sin(poses[30, 3])
    across = [np.hypot(c * 0.01, s * 0.02), np.hypot(s * 0.01, c * 0.02), 0.03]
    assert spread == pytest.approx([*across, 0.02, 0.01, 0.03, *[0.05] * 19], rel=5 / np.sqrt(2 * N))


def initial_constants(monkeypatch, **values):
    for name, value in values.items():
        monkeypatch.setattr(f"workbench.priors.implicit.INITIAL_{name}", value)


def test_initial_windows_end_near_the_pose(windows, poses, monkeypatch):
    initial_constants(monkeypatch, BETA=1e-4, POSITION_STD=0.0, ROTATION_STD=0.0, ANGLE_STD=0.0)
    prior = Implicit(windows)
    state = prior.sample_initial(poses[40], 10, np.random.default_rng(0))
    assert (prior.pose(state) == poses[40]).all()
    expected = prior.start_after(poses[30:41], 1)
    assert state[:, len(POSE_NAMES) :] == pytest.approx(np.repeat(expected[:, len(POSE_NAMES) :], 10, axis=0), abs=1e-4)


@pytest.mark.parametrize("rate_hz", [15.0, 30.0])
def test_initial_states_have_the_stated_deviations(motions, poses, monkeypatch, rate_hz):
    initial_constants(monkeypatch, POSITION_STD=0.03, ROTATION_STD=0.02, ANGLE_STD=0.04)
    prior = Implicit(learn_windows(motions, rate_hz=rate_hz))
    spread = prior.pose(prior.sample_initial(poses[40], N, np.random.default_rng(0))).std(axis=0)
    assert spread == pytest.approx([0.03] * 3 + [0.02] * 3 + [0.04] * 19, rel=5 / np.sqrt(2 * N))


def test_a_step_of_two_frames_is_two_steps(windows, poses):
    prior = Implicit(windows)
    start = prior.sample_initial(poses[30], 20, np.random.default_rng(0))
    once, twice = np.random.default_rng(1), np.random.default_rng(1)
    expected = prior.sample_transition(prior.sample_transition(start, DT, twice), DT, twice)
    assert (prior.sample_transition(start, 2 * DT, once) == expected).all()


def test_another_frame_rate_is_rejected(windows, poses):
    prior = Implicit(windows)
    with pytest.raises(InputError, match="30 Hz"):
        prior.sample_transition(
            prior.sample_initial(poses[30], 2, np.random.default_rng(0)), 1 / 50, np.random.default_rng(0)
        )
