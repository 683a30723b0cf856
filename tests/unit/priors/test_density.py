"""The density of a transition against draws from it: reweighted, the children of one state stand for another's."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from scipy.stats import multivariate_normal, truncnorm

from workbench.core.discrepancy import Discrepancy
from workbench.motion.models.training import activity_model
from workbench.motion.models.windows import learn_windows
from workbench.motion.synthetic.gait import builtin_motions
from workbench.priors import from_motions
from workbench.priors.activity import Activity
from workbench.priors.ar_offsets import SIGMA, AROffsets
from workbench.priors.density import state_difference
from workbench.priors.fitted_rest import FittedRest, Trajectory
from workbench.priors.implicit import Implicit
from workbench.priors.smooth import Smooth

DT = 1 / 25
N = 20_000
ARM = ["left_arm"]
KEPT = np.array([0.5, 0.95])
TRAJECTORY = Trajectory(np.array([0.0, 1.0]), np.stack([np.full(25, 0.1), np.full(25, 0.2)]))
NAMED = ["walking", "activity", "smooth", "ar_offsets", "offsets of smooth", "fitted_rest"]


@pytest.fixture(scope="module")
def priors(cache):
    folder = str(cache)
    walking = from_motions.walking(motions="builtin", cache=folder, n_components=3, sigma_rotation=(0.0, 0.01, 0.01))
    return {
        "walking": walking,
        "activity": Activity(activity_model(cache=folder, n_components=2)),
        "smooth": Smooth(parameters=ARM),
        "ar_offsets": AROffsets(walking, sigma=0.02, parameters=["left_arm"]),
        "offsets of smooth": AROffsets(Smooth(parameters=["right_arm"]), parameters=["left_elbow_flexion"]),
        "fitted_rest": FittedRest(Smooth(parameters=ARM), lambda: TRAJECTORY),
    }


def family(prior):
    """A parent near the end of its cycle and, where there are limits, at one; and another, half a deviation away."""
    rng = np.random.default_rng(0)
    pose = builtin_motions()[0].resampled(30.0).poses[0].copy()
    parent = prior.sample_initial(pose, 1, rng)
    for name in ("left_elbow_flexion", "right_elbow_flexion"):
        if name in prior.space.names:
            parent[0, prior.space.names.index(name)] = -0.09  # the limit is −0.1
    if "phase" in prior.space.names:
        parent[0, prior.space.names.index("phase")] = 0.99
    children = prior.sample_transition(np.repeat(parent, N, axis=0), DT, np.random.default_rng(1))
    spread = state_difference(prior.space, prior.capabilities.density.mean(parent, DT), children).std(axis=0)
    spread[[i for i in range(len(spread)) if i not in prior.capabilities.density.free]] = 0.0
    other = parent + 0.5 * spread * np.where(spread > 1e-12, rng.choice([-1.0, 1.0], len(spread)), 0.0)
    for i, name in enumerate(prior.space.names):
        if name.endswith("elbow_flexion"):
            other[0, i] = parent[0, i] + 0.5 * spread[i]
    return parent, other, children


@pytest.mark.parametrize("name", NAMED)
@pytest.mark.slow
def test_reweighted_children_have_the_moments_of_the_other_parents(priors, name):
    prior = priors[name]
    parent, other, children = family(prior)
    density = prior.capabilities.density
    log_ratio = density.log_transition(other, children, DT) - density.log_transition(parent, children, DT)
    assert np.isfinite(log_ratio).all()
    weights = np.exp(log_ratio)
    others = prior.sample_transition(np.repeat(other, N, axis=0), DT, np.random.default_rng(2))
    middle = density.mean(other, DT)
    found, expected = (state_difference(prior.space, middle, states)[:, density.free] for states in (children, others))
    for power in (0, 1, 2):
        weighted, plain = weights[:, None] * found**power, expected**power
        error = np.sqrt((weighted.var(axis=0) + plain.var(axis=0)) / N)
        assert (np.abs(weighted.mean(axis=0) - plain.mean(axis=0)) <= 5 * error + 1e-9).all()


def test_the_walking_priors_density_is_a_normal_distribution_in_the_columns_that_have_noise(priors):
    prior = priors["walking"]
    parent, _, children = family(prior)
    free = [i for i, name in enumerate(prior.space.names) if name != "root_heading"]
    sigma = np.array([0.05] * 3 + [0.009, 0.01] + [0.01] * 5) * np.sqrt(30.0 * DT)
    deviation = state_difference(prior.space, prior.mean(parent, DT), children)[:100, free]
    expected = multivariate_normal(np.zeros(len(free)), np.diag(sigma**2)).logpdf(deviation)
    np.testing.assert_allclose(prior.log_transition(parent, children[:100], DT), expected, rtol=1e-9)
    turned = children[:1].copy()
    turned[0, prior.space.names.index("root_heading")] += 0.01
    assert prior.log_transition(parent, turned, DT) == -np.inf


def test_the_smooth_priors_density_is_a_truncated_normal_distribution():
    prior = Smooth(parameters=["left_elbow_flexion"], sigma={"elbow": 0.05})
    state = prior.enter(np.zeros((1, 25)), np.zeros((1, 25)))
    values = np.linspace(-0.2, 0.2, 9)
    children = np.repeat(state, 9, axis=0)
    children[:, 0] = values
    velocity = -np.log(np.sqrt(2 * np.pi) * prior.sigma_velocity[0])
    expected = truncnorm(-0.1 / 0.05, 2.7 / 0.05, 0.0, 0.05).logpdf(values) + velocity
    np.testing.assert_allclose(prior.log_transition(state, children, 1 / 30), expected, rtol=1e-9)
    held = children.copy()
    held[:, -1] += 1e-3
    assert (prior.log_transition(state, held, 1 / 30) == -np.inf).all()


def test_offsets_forget_the_start_at_the_rate_that_was_asked_for(priors):
    prior = priors["ar_offsets"]
    parent, _, _ = family(prior)
    offsets = prior.space.slices["offsets"]
    parent[0, offsets] = 0.3
    for dt_s, frames in ((1 / 30, 1), (1 / 10, 3)):
        children = prior.sample_transition(np.repeat(parent, N, axis=0), dt_s, np.random.default_rng(3))[:, offsets]
        variance = 0.02**2 * sum(0.9 ** (2 * k) for k in range(frames))
        assert children.mean(axis=0) == pytest.approx(0.3 * 0.9**frames, abs=5 * np.sqrt(variance / N))
        assert children.var(axis=0) == pytest.approx(variance, rel=5 * np.sqrt(2 / N))


def test_offsets_start_as_they_are_in_the_long_run():
    """Of an autoregression that keeps k of itself, with noise σ: N(0, σ² / (1 − k²)), which a step leaves as it is."""
    prior, rng = AROffsets(Smooth(parameters=ARM), sigma=0.03, ar_coefficient=0.8), np.random.default_rng(0)
    state = prior.sample_initial(np.full(25, 0.1), N, rng)
    for states in (state, prior.sample_transition(state, 1 / 30, rng)):
        found = states[:, prior.space.slices["offsets"]].std(axis=0)
        assert found == pytest.approx(0.03 / 0.6, rel=5 / np.sqrt(2 * N))


def test_offsets_move_the_pose_and_nothing_else(priors):
    prior = priors["ar_offsets"]
    parent, _, _ = family(prior)
    moved = parent.copy()
    moved[0, prior.space.names.index("left_elbow_flexion_offset")] += 0.1
    change = prior.pose(moved)[0] - prior.pose(parent)[0]
    assert change[prior.parameters.index("left_elbow_flexion")] == pytest.approx(0.1)
    assert np.count_nonzero(change) == 1


def test_the_density_of_a_following_prior_is_the_bases(priors):
    prior = priors["fitted_rest"]
    parent, _, children = family(prior)
    found = prior.capabilities.density.log_transition(parent, children, DT)
    np.testing.assert_array_equal(found, prior.base.log_transition(parent[:, :-1], children[:, :-1], DT))
    late = children + np.eye(len(prior.space))[-1] * 1e-6
    assert (prior.capabilities.density.log_transition(parent, late, DT) == -np.inf).all()


@pytest.fixture(scope="module")
def windows():
    return learn_windows(builtin_motions(n_subjects=2), angles=ARM, include_root=False, window_frames=4)


@pytest.mark.parametrize("wrapped", ["ar_offsets", "fitted_rest"])
def test_around_an_implicit_prior_memories_are_drawn_given_the_pose(windows, wrapped):
    """By steps and by completing steps that forgot: means and products, within five standard errors."""
    base = Implicit(windows, beta=0.5, sigma_angles=0.1)
    prior = {
        "ar_offsets": AROffsets(base, sigma=0.05),
        "fitted_rest": FittedRest(base, lambda: TRAJECTORY),
    }[wrapped]
    density, dt_s = prior.capabilities.density, 1 / 30
    parent = prior.sample_initial(builtin_motions()[0].resampled(30.0).poses[0], 1, np.random.default_rng(0))
    n = N // 4
    parents = np.repeat(parent, n, axis=0)
    stepped, forgotten = (prior.sample_transition(parents, dt_s, np.random.default_rng(seed)) for seed in (1, 2))
    follows = np.setdiff1d(np.arange(len(prior.space)), density.free)
    assert len(follows) == len(base.space) - 25
    forgotten[:, follows] = np.nan
    completed = density.sample_dependent(parents, forgotten, dt_s, np.random.default_rng(3))
    assert (completed[:, density.free] == forgotten[:, density.free]).all()
    assert np.isfinite(density.log_transition(parents, forgotten, dt_s)).all()
    middle = stepped.mean(axis=0)
    mine, true = completed - middle, stepped - middle
    for i in np.flatnonzero(true.std(axis=0) > 1e-9):
        for one, two in ((mine, true), (mine * mine[:, [i]], true * true[:, [i]])):
            error = np.sqrt((one.var(axis=0) + two.var(axis=0)) / n)
            assert (np.abs(one.mean(axis=0) - two.mean(axis=0)) <= 5.5 * error + 1e-9).all()


def test_offsets_are_as_large_as_what_the_model_misses():
    """Angle by angle, in the long run; those it knows nothing of, and bases that know nothing, have one number. Learned
    from three people, it is √3 as large for the next."""
    base = Smooth()
    missed = Discrepancy(("neck_nod", "left_elbow_flexion"), np.array([[0.3], [0.0]]), np.array([0.4, 0.1]), KEPT, 3)
    base_that_knows = SimpleNamespace(
        capabilities=replace(base.capabilities, discrepancy=missed),
        space=base.space,
        parameters=base.parameters,
        sample_initial=base.sample_initial,
    )
    wide = np.sqrt(3.0) * np.array([0.5, 0.1])
    for ar_coefficient, kept in ((0.9, [0.9, 0.9]), (None, KEPT)):
        prior = AROffsets(base_that_knows, ar_coefficient=ar_coefficient)
        which = [prior.space.names[prior.appended].index(f"{name}_offset") for name in missed.angles]
        np.testing.assert_allclose(prior.ar_coefficients[which], kept)
        np.testing.assert_allclose((prior.sigma / np.sqrt(1.0 - prior.ar_coefficients**2))[which], wide)
        others = np.delete(np.arange(len(prior.sigma)), which)
        assert set(prior.sigma[others]) == {SIGMA}
        drawn = prior.sample_initial(np.zeros(25), 20_000, np.random.default_rng(1))[:, prior.appended]
        np.testing.assert_allclose(drawn[:, which].std(axis=0), wide, rtol=5 * np.sqrt(0.5 / 20_000))
    assert set(AROffsets(base_that_knows, sigma=0.05).sigma) == {0.05}
    assert set(AROffsets(base).sigma) == {SIGMA}
