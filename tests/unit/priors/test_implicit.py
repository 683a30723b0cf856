"""The implicit prior: predictions against the database, sharing, held parts, and refusals."""

import numpy as np
import pytest

from workbench.body.skeleton import N_ROOT, PARTS, POSE_NAMES
from workbench.motion.models.windows import learn_windows
from workbench.motion.synthetic.gait import builtin_motions
from workbench.priors.implicit import Implicit
from workbench.utils.errors import InputError

STILL = {"sigma_position": (0.0,) * 3, "sigma_rotation": (0.0,) * 3, "sigma_angles": 0.0}
CERTAIN = {"beta": 1e-6, **STILL}  # so cold that an entry's own window finds nothing but itself
DT = 1 / 30


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
    prior = Implicit(windows, prediction=prediction, **CERTAIN)
    state, rng = prior.start_after(poses[20:31], 3), np.random.default_rng(0)
    for k in range(31, 60):
        state = prior.sample_transition(state, DT, rng)
        assert prior.pose(state) == pytest.approx(np.repeat(poses[k : k + 1], 3, axis=0), abs=1e-4)  # float32 rows


def test_the_motion_turns_with_the_body(windows, poses):
    turned = poses.copy()
    c, s = np.cos(2.0), np.sin(2.0)
    turned[:, :2] = poses[:, :2] @ np.array([[c, s], [-s, c]]) + [5.0, 1.0]
    turned[:, 3] += 2.0
    prior = Implicit(windows, **CERTAIN)
    state = prior.sample_transition(prior.start_after(turned[20:31], 1), DT, np.random.default_rng(0))
    assert prior.pose(state)[0] == pytest.approx(turned[31], abs=1e-4)


def test_predictions_follow_their_definitions(windows, poses):
    """Copy lands on ψ_{i+1}, increment adds ψ_{i+1} − ψ_i, a pull of a quarter lies between."""
    entries, offset = np.array([40, 90]), 0.2
    rows = windows.rows.astype(np.float64)
    before, after = (rows[windows.ends[entries] + k][:, : len(PARTS["body"])] for k in (0, 1))
    expected = {"copy": after, "increment": after - before, "blend": after - before}
    for prediction, target in expected.items():
        prior = Implicit(windows, prediction=prediction, blend_rate=0.25, **STILL)
        state = prior.start_after(poses[20:31] + offset, 2)
        now = state[:, N_ROOT : len(POSE_NAMES)]
        moved = prior.predict(state, entries, np.zeros((2, len(POSE_NAMES))))[:, N_ROOT : len(POSE_NAMES)]
        if prediction == "increment":
            target = now + target
        if prediction == "blend":
            target = now + target + 0.25 * (before - now)
        assert moved == pytest.approx(target, abs=1e-9)


def test_the_window_in_the_state_is_that_of_the_particles_own_motion(windows, poses):
    """After d steps the coefficients are those of the d poses the particle went through (no noise)."""
    prior, rng = Implicit(windows, prediction="increment", beta=0.5, **STILL), np.random.default_rng(1)
    state = prior.start_after(poses[20:31], 5)
    track = [prior.pose(state)]
    for _ in range(windows.window_frames):
        state = prior.sample_transition(state, DT, rng)
        track.append(prior.pose(state))
    b = len(windows.sigmas)
    for particle in range(5):
        own = prior.start_after(np.array([poses[particle] for poses in track]), 1)
        coefficients = state[particle, prior.space.slices["coefficients"]]
        assert coefficients == pytest.approx(own[0, len(POSE_NAMES) : len(POSE_NAMES) + b], abs=1e-4)


def test_noise_has_the_stated_deviations(windows, poses):
    sigmas = {"sigma_position": (0.01, 0.02, 0.03), "sigma_rotation": (0.02, 0.01, 0.03), "sigma_angles": 0.05}
    prior = Implicit(windows, beta=1e-6, **sigmas)
    state = prior.sample_transition(prior.start_after(poses[20:31], 20000), DT, np.random.default_rng(0))
    spread = prior.pose(state).std(axis=0)
    c, s = np.cos(poses[30, 3]), np.sin(poses[30, 3])
    across = [np.hypot(c * 0.01, s * 0.02), np.hypot(s * 0.01, c * 0.02), 0.03]
    assert spread[:3] == pytest.approx(across, rel=0.03)
    assert spread[3:6] == pytest.approx([0.02, 0.01, 0.03], rel=0.03)
    assert spread[6:] == pytest.approx(0.05, rel=0.03)


def initial_constants(monkeypatch, **values):
    for name, value in values.items():
        monkeypatch.setattr(f"workbench.priors.implicit.INITIAL_{name}", value)


def test_start_finds_windows_that_end_near_the_pose(windows, poses, monkeypatch):
    initial_constants(monkeypatch, BETA=1e-4, POSITION_STD=0.0, ROTATION_STD=0.0, ANGLE_STD=0.0)
    prior = Implicit(windows)
    state = prior.sample_initial(poses[40], 10, np.random.default_rng(0))
    assert (prior.pose(state) == poses[40]).all()
    own = prior.start_after(poses[30:41], 1)
    assert state[:, len(POSE_NAMES) :] == pytest.approx(np.repeat(own[:, len(POSE_NAMES) :], 10, axis=0), abs=1e-4)


def test_start_spreads_as_asked(windows, poses, monkeypatch):
    initial_constants(monkeypatch, POSITION_STD=0.03, ROTATION_STD=0.02, ANGLE_STD=0.04)
    prior = Implicit(windows)
    spread = prior.pose(prior.sample_initial(poses[40], 20000, np.random.default_rng(0))).std(axis=0)
    assert spread == pytest.approx([0.03] * 3 + [0.02] * 3 + [0.04] * 19, rel=0.03)


def test_two_frames_at_once_are_two_steps(windows, poses):
    prior = Implicit(windows)
    start = prior.sample_initial(poses[30], 20, np.random.default_rng(0))
    once, twice = np.random.default_rng(1), np.random.default_rng(1)
    expected = prior.sample_transition(prior.sample_transition(start, DT, twice), DT, twice)
    assert (prior.sample_transition(start, 2 * DT, once) == expected).all()


def test_a_video_of_another_rate_is_refused(windows, poses):
    prior = Implicit(windows)
    with pytest.raises(InputError, match="30 Hz"):
        prior.sample_transition(
            prior.sample_initial(poses[30], 2, np.random.default_rng(0)), 1 / 50, np.random.default_rng(0)
        )
