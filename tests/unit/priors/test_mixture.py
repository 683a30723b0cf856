"""Mixtures of linear-Gaussian toy priors, whose moments, densities and evidence can be enumerated."""

from itertools import product

import numpy as np
import pytest
from scipy.stats import norm

from workbench.body.skeleton import POSE_NAMES
from workbench.core.frame import Frame
from workbench.core.likelihood import Evaluation
from workbench.core.prior import Powers
from workbench.core.state_space import StateSpace
from workbench.inference.smc.particle_filter import ParticleFilter
from workbench.priors.mixture import Mixture, Switching, stratified_choice
from workbench.priors.smooth import Smooth
from workbench.utils.errors import InputError

DT = 1 / 30
P = len(POSE_NAMES)


class Line:
    """x_t = a x_t−1 + b + N(0, q²), started at pose[0] + N(0, 0.2²); x is the pose's first number, the rest 0."""

    parameters = ("root_x",)
    powers = Powers()

    def __init__(self, a, b, q, name="x"):
        self.a, self.b, self.q = a, b, q
        self.space = StateSpace.of({name: ((name,), "m")})

    def start(self, pose, n, rng):
        return pose[0] + 0.2 * rng.standard_normal((n, 1))

    def step(self, state, dt_s, rng):
        return self.a * state + self.b + self.q * rng.standard_normal(state.shape)

    def pose(self, state):
        poses = np.zeros((len(state), P))
        poses[:, 0] = state[:, 0]
        return poses


class Carrying(Line):
    """The same, and takes over particles at their pose plus a tenth of their velocity."""

    def enter(self, poses, velocities):
        return poses[:, :1] + 0.1 * velocities[:, :1]


SLOW, FAST = Line(0.9, 0.1, 0.2), Line(1.1, -0.4, 0.5)
WEIGHTS = {"slow": 0.7, "fast": 0.3}
SHARES = {"slow": 0.25, "fast": 0.75}


def mixture(**options):
    return Mixture({"slow": SLOW, "fast": FAST}, WEIGHTS, **options)


def pose_at(x):
    return np.r_[x, np.zeros(P - 1)]


def sequences(n_steps):
    """Every sequence of components: (probability, mean, variance) of x after it, from x_0 ~ N(1, 0.2²)."""
    for path in product((SLOW, FAST), repeat=n_steps):
        mean, variance, probability = 1.0, 0.2**2, 1.0
        for prior in path:
            mean, variance = prior.a * mean + prior.b, prior.a**2 * variance + prior.q**2
            probability *= WEIGHTS["slow" if prior is SLOW else "fast"]
        yield probability, mean, variance


def moments(n_steps):
    """Mean and variance of x after n steps."""
    p, mean, variance = np.array(list(sequences(n_steps))).T
    return p @ mean, p @ (variance + (mean - p @ mean) ** 2)


def close(value, expected, error):
    assert abs(value - expected) <= 5.0 * error


@pytest.mark.parametrize("n_steps", [1, 3])
def test_moments_agree_with_the_enumeration_of_all_sequences(n_steps):
    prior, rng, n = mixture(), np.random.default_rng(0), 40000
    state = prior.start(pose_at(1.0), n, rng)
    for _ in range(n_steps):
        state = prior.step(state, DT, rng)
    mean, variance = moments(n_steps)
    x = state[:, 0]
    close(x.mean(), mean, np.sqrt(variance / n))
    close(((x - mean) ** 2).mean(), variance, ((x - mean) ** 2).std() / np.sqrt(n))


def test_every_component_draws_from_its_own_prior():
    state = np.tile([2.0, 0.0], (40000, 1))
    moved = mixture().step(state, DT, np.random.default_rng(1))
    for k, prior in enumerate((SLOW, FAST)):
        own = moved[moved[:, 1] == k, 0]
        close(own.mean(), prior.a * 2.0 + prior.b, prior.q / np.sqrt(len(own)))
        assert own.std() == pytest.approx(prior.q, rel=5 / np.sqrt(2 * len(own)))


@pytest.mark.parametrize("n", [1, 7, 10, 1000])
def test_the_priors_get_their_parts_of_the_particles_to_within_one(n):
    for seed in range(20):
        counts = np.bincount(
            stratified_choice(np.array([0.5, 0.0, 0.3, 0.2]), n, np.random.default_rng(seed)), minlength=4
        )
        assert np.abs(counts - n * np.array([0.5, 0.0, 0.3, 0.2])).max() < 1.0 + 1e-9
        assert counts[1] == 0


def test_every_single_particle_gets_a_component_by_its_probability():
    """Else particles of the same parent, which lie side by side after resampling, would all go to one prior."""
    rng = np.random.default_rng(0)
    first = np.array([stratified_choice(np.array([0.7, 0.3]), 5, rng) for _ in range(20000)]).mean(axis=0)
    assert np.abs(first - 0.3).max() <= 5 * np.sqrt(0.3 * 0.7 / 20000)


def test_a_step_goes_by_the_weights_whatever_the_shares():
    """A filter that knows no corrections must stay exact."""
    moved = mixture(shares=SHARES).step(np.zeros((100, 2)), DT, np.random.default_rng(0))
    assert moved[:, 1].sum() == 30


def test_corrected_shares_have_the_moments_of_the_mixture():
    prior, rng, n = mixture(shares=SHARES), np.random.default_rng(3), 60000
    state, log_weights = prior.start(pose_at(1.0), n, rng), np.zeros(n)
    for t in range(3):
        state, correction = prior.propose(state, DT, rng)
        log_weights += correction
        assert (state[:, 1] == 1).mean() == pytest.approx(0.75, abs=1 / n)
        # the average correction, Σ_k κ_k π_k / κ_k, is one; 0.25 n and 0.75 n are whole numbers
        assert np.exp(correction).mean() == pytest.approx(1.0, abs=1e-12), t
    weights = np.exp(log_weights)
    mean, variance = moments(3)
    x = state[:, 0]
    close((weights * x).mean(), mean, (weights * x).std() / np.sqrt(n))
    close((weights * (x - mean) ** 2).mean(), variance, (weights * (x - mean) ** 2).std() / np.sqrt(n))
    assert abs(x.mean() - mean) > 20 * np.sqrt(variance / n)  # what leaving the correction out would give


def test_the_correction_is_the_ratio_of_weight_and_share():
    state = np.array([[0.0, 0.0], [5.0, 1.0], [1.0, 0.0]])
    expected = np.log([0.7 / 0.25, 0.3 / 0.75, 0.7 / 0.25])
    assert mixture(shares=SHARES).log_correction(state) == pytest.approx(expected)
    assert (mixture().log_correction(state) == 0.0).all()
    impossible = Mixture({"a": SLOW, "b": FAST}, {"a": 1.0, "b": 0.0}, shares={"a": 0.5, "b": 0.5})
    assert impossible.log_correction(state) == pytest.approx(np.array([np.log(2.0), -np.inf, np.log(2.0)]))


class Measured:
    """y_t = x_t + N(0, 0.4²)."""

    y = (np.nan, 0.8, 1.6, 0.3)

    notes, diagnostics, index = (), {}, 0

    def look(self, previous, frame):
        self.index = frame.index
        return self

    def evaluate(self, previous_pose, pose):
        return Evaluation(norm.logpdf(self.y[self.index], pose[:, 0], 0.4))

    def remember(self, expected_pose):
        return self


def exact_posterior():
    """log p(y_1..3) and E[x_3 | y], over all 8 sequences of components, a Kalman filter for each."""
    evidence, means = [], []
    for path in product((SLOW, FAST), repeat=3):
        mean, variance, log_p = 1.0, 0.2**2, 0.0
        for prior, y in zip(path, Measured.y[1:], strict=True):
            mean, variance = prior.a * mean + prior.b, prior.a**2 * variance + prior.q**2
            log_p += np.log(0.7 if prior is SLOW else 0.3) + norm.logpdf(y, mean, np.sqrt(variance + 0.16))
            gain = variance / (variance + 0.16)
            mean, variance = mean + gain * (y - mean), (1.0 - gain) * variance
        evidence.append(log_p)
        means.append(mean)
    p = np.exp(evidence)
    return np.log(p.sum()), p @ means / p.sum()


def test_the_particle_filter_finds_the_exact_posterior_of_the_mixture():
    frames = [Frame(index=t, time_s=t * DT, views=()) for t in range(4)]
    rows = []
    for seed in range(20):
        children = np.random.SeedSequence(seed).spawn(3)
        streams = dict(zip(("start", "resampling", "prior"), map(np.random.default_rng, children), strict=True))
        *_, last = ParticleFilter(mixture(), Measured(), n_particles=4000).run(frames, pose_at(1.0), streams)
        rows.append([last.log_evidence, last.expected_pose[0]])
    rows = np.array(rows)
    assert (np.abs(rows.mean(axis=0) - exact_posterior()) <= 5 * rows.std(axis=0) / np.sqrt(20)).all()


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"priors": {}, "weights": {}}, "at least one"),
        ({"weights": {"slow": 1.0}}, "weights must be given for slow, fast, found slow"),
        ({"weights": {"slow": 0.7, "fast": 0.7}}, "sum to one"),
        ({"weights": {"slow": 1.5, "fast": -0.5}}, "sum to one"),
        ({"shares": {"slow": 1.0, "fast": 0.0}}, "'fast' has a weight, but no share"),
        ({"priors": {"slow": SLOW, "fast": Line(1, 0, 1, "y")}}, "must have the same columns"),
    ],
)
def test_bad_mixtures_are_refused(options, message):
    with pytest.raises(InputError, match=message):
        Mixture(**{"priors": {"slow": SLOW, "fast": FAST}, "weights": WEIGHTS, **options})


CARRYING = Carrying(1.1, -0.4, 0.5, "y")


def switching(s, entering=CARRYING):
    return Switching({"slow": SLOW, "fast": entering}, WEIGHTS, switching=s)


def test_switching_states_lie_side_by_side():
    prior = switching(0.1)
    velocities = tuple(f"{name}_velocity" for name in POSE_NAMES)
    assert prior.space.names == ("slow.x", "fast.y", *velocities, "component")
    state = prior.start(pose_at(1.0), 100, np.random.default_rng(0))
    assert (state[:, -1] == 1).sum() == 30
    for _ in range(3):
        fast = state[:, -1] == 1
        assert (state[fast, 0] == 0.0).all()
        assert (state[~fast, 1] == 0.0).all()
        before = prior.pose(state)
        assert (before[:, 0] == np.where(fast, state[:, 1], state[:, 0])).all()
        state = prior.step(state, DT, np.random.default_rng(1))
        change = (prior.pose(state) - before) / DT
        assert state[:, prior.space.slices["velocity"]] == pytest.approx(change)


@pytest.mark.parametrize("dt_s", [DT, 3.5 * DT])
def test_components_follow_their_markov_chain(dt_s):
    """P(1 → 1) = e + (1 − e) π_1 and P(0 → 1) = (1 − e) π_1, e = (1 − s)^(30 Δt)."""
    prior, n = switching(0.2), 20000
    kept = 0.8 ** (30 * dt_s)
    for before, expected in ((0.0, (1 - kept) * 0.3), (1.0, kept + (1 - kept) * 0.3)):
        state = np.zeros((n, len(prior.space)))
        state[:, -1] = before
        after = prior.step(state, dt_s, np.random.default_rng(4))[:, -1]
        close(after.mean(), expected, np.sqrt(expected * (1 - expected) / n))


@pytest.mark.parametrize(("entering", "shift"), [(CARRYING, 0.1 * 3.0), (Line(1.1, -0.4, 0.5, "y"), 0.0)])
def test_a_particle_that_switches_is_handed_over(entering, shift):
    """With `enter`: at its pose, with its velocity (3 m/s). Without: by `start` around its pose (deviation 0.2)."""
    prior, n = switching(1.0, entering), 30000
    state = np.zeros((n, len(prior.space)))
    state[:, 0] = np.repeat([2.0, 5.0], n // 2)
    state[:, prior.space.slices["velocity"].start] = 3.0
    moved = prior.step(state, DT, np.random.default_rng(5))
    start = 0.0 if shift else 0.2
    for x, half in ((2.0, slice(n // 2)), (5.0, slice(n // 2, n))):
        new = moved[half][moved[half, -1] == 1, 1]
        deviation = np.hypot(1.1 * start, 0.5)
        close(new.mean(), 1.1 * (x + shift) - 0.4, deviation / np.sqrt(len(new)))
        assert new.std() == pytest.approx(deviation, rel=5 / np.sqrt(2 * len(new)))
        old = moved[half][moved[half, -1] == 0, 0]
        close(old.mean(), 0.9 * x + 0.1, 0.2 / np.sqrt(len(old)))


def test_without_switching_every_particle_keeps_its_prior():
    prior, rng = switching(0.0), np.random.default_rng(6)
    state = prior.start(pose_at(1.0), 50, rng)
    moved = prior.step(state, DT, rng)
    assert (moved[:, -1] == state[:, -1]).all()


def test_a_smooth_prior_takes_over_pose_and_velocity_exactly():
    """Two smooth priors without noise: a switch must not disturb the motion."""
    still = dict.fromkeys(("root_position", "root_rotation", "neck", "shoulder", "elbow", "hip", "knee"), 0.0)
    calm = Smooth(sigma=still, sigma_velocity=still)
    prior, rng = Switching({"a": calm, "b": calm}, {"a": 0.5, "b": 0.5}, switching=0.5), np.random.default_rng(7)
    pose, velocities = np.full(P, 0.2), np.linspace(-1.0, 1.0, P)
    state = np.zeros((200, len(prior.space)))
    state[:, prior.space.slices["a"]] = calm.enter(pose[None], velocities[None])
    state[:, prior.space.slices["velocity"]] = velocities
    free = [i for i, name in enumerate(POSE_NAMES) if name.startswith("root")]  # the rest may meet its limits
    for t in range(1, 5):
        state = prior.step(state, DT, rng)
        assert prior.pose(state)[:, free] == pytest.approx(np.tile((pose + t * DT * velocities)[free], (200, 1)))
    assert 0 < state[:, -1].sum() < 200


@pytest.mark.parametrize("s", [-0.1, 1.1, float("nan")])
def test_a_switching_probability_is_one(s):
    with pytest.raises(InputError, match="switching"):
        switching(s)
