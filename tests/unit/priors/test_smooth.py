"""The smooth prior: the truncated normal against SciPy, moments against closed forms, velocities, time steps."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.stats import kstest, norm, truncnorm

from workbench.body.shape import from_height
from workbench.body.skeleton import POSE_NAMES, person_skeleton
from workbench.priors.smooth import SIGMA, SIGMA_VELOCITY, Smooth, truncated_normal

SKELETON = person_skeleton(from_height(1.7))
ARM = tuple(f"right_{name}" for name in ("shoulder_abduction", "shoulder_flexion", "shoulder_twist", "elbow_flexion"))
POSE = np.linspace(0.05, 0.6, 25)
N = 20000


def repeated_state(prior, pose, velocities):
    """Return N equal states of a pose and the velocities of all 25 parameters."""
    return prior.enter(np.tile(pose, (N, 1)), np.tile(velocities, (N, 1)))


def column(prior, state, name):
    return state[:, prior.space.names.index(name)]


def check_moments(sample, mean, deviation):
    """Check the mean and deviation of a sample to 5 standard errors (for normal tails or lighter)."""
    assert np.abs(sample.mean(axis=0) - mean).max() <= 5.0 * np.max(deviation) / np.sqrt(len(sample))
    assert sample.std(axis=0) == pytest.approx(deviation, rel=5.0 / np.sqrt(2 * len(sample)))


@pytest.mark.parametrize(
    ("mean", "deviation", "low", "high"),
    [
        (0.0, 1.0, -0.5, 2.0),
        (5.0, 0.3, -1.0, 1.0),
        (-9.0, 0.5, -1.0, 1.0),
        (0.2, 10.0, -0.1, 0.3),
        (0.0, 1.0, 3.0, 9.0),
    ],
)
def test_quantiles_agree_with_scipy(mean, deviation, low, high):
    u = np.linspace(0.001, 0.999, 997)
    quantiles = truncated_normal(np.full(997, mean), deviation, low, high, u)
    expected = truncnorm.ppf(u, (low - mean) / deviation, (high - mean) / deviation, loc=mean, scale=deviation)
    assert quantiles == pytest.approx(expected, rel=1e-9, abs=1e-12)


@pytest.mark.parametrize("side", [1.0, -1.0])
@pytest.mark.parametrize("far", [1e2, 1e3, 1e4])
def test_far_beyond_a_limit_the_depth_inside_is_exponential(far, side):
    """Mills' ratio: for a limit at `far` deviations, depth × far → Exp(1), off by a few parts in far²."""
    u = np.linspace(0.01, 0.99, 99)
    draws = truncated_normal(np.zeros(99), 1.0, *np.sort([side * far, side * (far + 1e3)]), u)
    depth = np.sort(np.abs(draws - side * far) * far)
    # ndtri_exp(log_ndtr(z)) equals z to 6e-13 (measured), and the depth is exact to far² times that
    assert depth == pytest.approx(-np.log(1.0 - u), rel=5.0 / far**2, abs=1e-12 * far**2)


def test_draws_respect_limits_of_any_distance():
    draws = truncated_normal(
        np.array([1e300, -1e300, 1e6, 0.5, 0.5, 2.0]), np.array([1, 1, 1e-9, 0, 1e-300, 0]), 0, 1, 0.3
    )
    assert draws.tolist() == [1.0, 0.0, 1.0, 0.5, 0.5, 1.0]


@pytest.mark.parametrize("dt_s", [1 / 30, 1 / 120])
def test_one_step_away_from_limits(dt_s):
    """The means are φ + V Δt and e^(−damping Δt) V; the deviations grow with the root of time."""
    prior = Smooth(damping=2.0)
    velocities = np.linspace(-1.0, 1.0, 25)
    state = repeated_state(prior, POSE, velocities)
    moved = prior.sample_transition(state, dt_s, np.random.default_rng(0))
    growth = np.sqrt(30 * dt_s)
    free = [i for i, name in enumerate(POSE_NAMES) if np.ptp(SKELETON.limits[i]) > 100]
    check_moments(moved[:, free], (POSE + dt_s * velocities)[free], growth * prior.sigma[free])
    velocity = moved[:, prior.space.slices["velocity"]]
    check_moments(velocity, np.exp(-2.0 * dt_s) * velocities, growth * prior.sigma_velocity)


@pytest.mark.parametrize("velocity", [0.0, 1.0, 20.0, -300.0])
def test_draws_near_a_limit_follow_the_truncated_normal(velocity):
    """A step from just under the elbow's upper limit is truncated as by SciPy, not clipped."""
    prior, dt_s, name = Smooth(parameters=ARM, sigma={"elbow": 0.05}), 1 / 30, "right_elbow_flexion"
    low, high = SKELETON.limits[POSE_NAMES.index(name)]
    pose = POSE.copy()
    pose[POSE_NAMES.index(name)] = high - 0.03
    moved = prior.sample_transition(repeated_state(prior, pose, np.full(25, velocity)), dt_s, np.random.default_rng(2))
    mean = high - 0.03 + velocity * dt_s
    expected = truncnorm((low - mean) / 0.05, (high - mean) / 0.05, loc=mean, scale=0.05)
    assert kstest(column(prior, moved, name), expected.cdf).pvalue > 1e-4
    assert column(prior, moved, f"{name}_velocity").mean() == pytest.approx(velocity, abs=5 * 0.65 / np.sqrt(N))


def test_samples_of_the_papers_density_are_weighted_by_the_probability_within_the_limits():
    velocities, dt_s = np.zeros(25), 0.1
    velocities[[POSE_NAMES.index(name) for name in ARM]] = [12.0, -9.0, 0.5, -6.0]
    for normalized in (True, False):
        prior = Smooth(parameters=ARM, normalized=normalized)
        state = repeated_state(prior, POSE, velocities)[:3]
        moved, log_weights = prior.propose(state, dt_s, np.random.default_rng(0))
        np.testing.assert_array_equal(moved, prior.sample_transition(state, dt_s, np.random.default_rng(0)))
        predicted = state[0, :4] + dt_s * state[0, 4:8]
        below = norm.cdf(prior.limits, loc=predicted[:, None], scale=prior.sigma[:, None] * np.sqrt(3.0))
        expected = 0.0 if normalized else np.log(np.diff(below, axis=1)).sum()
        assert log_weights == pytest.approx(np.full(3, expected), rel=1e-6)
    assert expected < -1.0


def test_initial_states_are_around_the_pose_or_uniform():
    twist = "right_shoulder_twist"
    prior = Smooth(parameters=ARM, initial_pose_scale=1.5, initial_uniform=[twist])
    state = prior.sample_initial(POSE, N, np.random.default_rng(0))
    low, high = SKELETON.limits[POSE_NAMES.index(twist)]
    assert kstest(column(prior, state, twist), "uniform", (low, high - low)).pvalue > 1e-4
    normal = [i for i, name in enumerate(ARM) if name != twist and name != "right_elbow_flexion"]
    expected = [POSE[POSE_NAMES.index(ARM[i])] for i in normal]
    check_moments(state[:, normal], expected, 1.5 * prior.sigma[normal])
    check_moments(state[:, prior.space.slices["velocity"]], np.zeros(4), 3.0 * prior.sigma_velocity)


def test_deviations_are_those_of_the_parameter_its_joint_or_its_body_part():
    deviations = {"right_elbow_flexion": 0.5, "shoulder": 0.2, "hip_twist": 0.3, "root_rotation": 0.0}
    sigma = dict(zip(POSE_NAMES, Smooth(sigma=deviations).sigma, strict=True))
    assert (sigma["right_elbow_flexion"], sigma["left_elbow_flexion"]) == (0.5, SIGMA["elbow"])
    assert sigma["left_shoulder_twist"] == sigma["right_shoulder_flexion"] == 0.2
    assert (sigma["left_hip_twist"], sigma["left_hip_flexion"]) == (0.3, SIGMA["hip"])
    assert (sigma["root_roll"], sigma["root_x"]) == (0.0, SIGMA["root_position"])
    assert dict(zip(POSE_NAMES, Smooth().sigma_velocity, strict=True))["neck_nod"] == SIGMA_VELOCITY["neck"]


def test_a_parameter_without_noise_keeps_its_value():
    prior = Smooth(sigma={"root_rotation": 0.0}, sigma_velocity={"root_rotation": 0.0})
    rng = np.random.default_rng(0)
    state = prior.sample_transition(prior.sample_initial(POSE, 20, rng), 1 / 30, rng)
    assert (prior.pose(state)[:, 3:6] == POSE[3:6]).all()


def test_the_mean_follows_the_velocity_up_to_the_limits():
    prior, dt_s = Smooth(parameters=ARM, damping=2.0), 0.1
    low, high = SKELETON.limits[[POSE_NAMES.index(name) for name in ARM]].T
    velocities = np.zeros(25)
    velocities[[POSE_NAMES.index(name) for name in ARM]] = [1.0, -1.0, 100.0, -100.0]
    mean = prior.mean(prior.enter(POSE[None], velocities[None]), dt_s)[0]
    start = POSE[[POSE_NAMES.index(name) for name in ARM]]
    assert mean[:4] == pytest.approx([start[0] + 0.1, start[1] - 0.1, high[2], low[3]])
    assert mean[4:8] == pytest.approx(np.exp(-0.2) * np.array([1.0, -1.0, 100.0, -100.0]))


def test_an_initial_pose_outside_the_limits_is_reported_and_moved_inside(caplog):
    prior, pose = Smooth(parameters=ARM), POSE.copy()
    pose[POSE_NAMES.index("right_elbow_flexion")] = 3.0
    state = prior.sample_initial(pose, 100, np.random.default_rng(0))
    assert "right_elbow_flexion is 3.000, outside" in caplog.text
    elbow = column(prior, state, "right_elbow_flexion")
    assert (elbow <= 2.7).all()
    assert elbow.mean() > 2.65


NAMES = ("root_heading", "left_knee_flexion")
finite = st.floats(-50.0, 50.0)
limits = st.tuples(finite, st.floats(1e-6, 10.0)).map(lambda pair: [pair[0], pair[0] + pair[1]])
deviations = st.floats(0.0, 100.0)


@settings(max_examples=40)
@given(
    a=limits, b=limits, sigma=deviations, sigma_velocity=deviations, pose=finite,
    dt_s=st.floats(0.0, 2.0), seed=st.integers(0, 10**6),
)  # fmt: skip
def test_no_draw_leaves_the_limits(a, b, sigma, sigma_velocity, pose, dt_s, seed):
    prior = Smooth(
        parameters=NAMES,
        lower=dict(zip(NAMES, (a[0], b[0]), strict=True)),
        upper=dict(zip(NAMES, (a[1], b[1]), strict=True)),
        sigma=dict.fromkeys(NAMES, sigma),
        sigma_velocity=dict.fromkeys(NAMES, sigma_velocity),
        initial_uniform=["root_heading"],
    )
    rng = np.random.default_rng(seed)
    state = prior.sample_initial(np.full(len(POSE_NAMES), pose), 30, rng)
    for _ in range(3):
        assert np.isfinite(state).all()
        for i, (low, high) in enumerate((a, b)):
            assert ((low <= state[:, i]) & (state[:, i] <= high)).all()
        state = prior.sample_transition(state, dt_s, rng)
