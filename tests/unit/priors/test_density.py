"""Transition densities of priors against closed forms and against samples that they reweight."""

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
AR_COEFFICIENTS = np.array([0.5, 0.95])
TRAJECTORY = Trajectory(np.array([0.0, 1.0]), np.stack([np.full(25, 0.1), np.full(25, 0.2)]))
NAMES = ["walking", "activity", "smooth", "ar_offsets", "offsets of smooth", "fitted_rest"]


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
    """Return a parent at a cycle's end or near a limit, another half a deviation away, and children of the first."""
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


@pytest.mark.parametrize("name", NAMES)
@pytest.mark.slow
def test_reweighted_children_have_the_moments_of_the_other_parents_children(priors, name):
    prior = priors[name]
    parent, other, children = family(prior)
    density = prior.capabilities.density
    log_ratio = density.log_transition(other, children, DT) - density.log_transition(parent, children, DT)
    assert np.isfinite(log_ratio).all()
    weights = np.exp(log_ratio)
    expected = prior.sample_transition(np.repeat(other, N, axis=0), DT, np.random.default_rng(2))
    mean = density.mean(other, DT)
    children, expected = (
        state_difference(prior.space, mean, states)[:, density.free] for states in (children, expected)
    )
    for power in (0, 1, 2):
        weighted, plain = weights[:, None] * children**power, expected**power
        error = np.sqrt((weighted.var(axis=0) + plain.var(axis=0)) / N)
        assert (np.abs(weighted.mean(axis=0) - plain.mean(axis=0)) <= 5 * error + 1e-9).all()


def test_the_walking_density_is_normal_in_the_columns_with_noise(priors):
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


def test_the_smooth_density_is_a_truncated_normal():
    prior = Smooth(parameters=["left_elbow_flexion"], sigma={"elbow": 0.05})
    state = prior.enter(np.zeros((1, 25)), np.zeros((1, 25)))
    values = np.linspace(-0.2, 0.2, 9)
    children = np.repeat(state, 9, axis=0)
    children[:, 0] = values
    velocity = -np.log(np.sqrt(2 * np.pi) * prior.sigma_velocity[0])
    expected = truncnorm(-0.1 / 0.05, 2.7 / 0.05, 0.0, 0.05).logpdf(values) + velocity
    np.testing.assert_allclose(prior.log_transition(state, children, 1 / 30), expected, rtol=1e-9)
    accelerated = children.copy()
    accelerated[:, -1] += 1e-3
    assert (prior.log_transition(state, accelerated, 1 / 30) == -np.inf).all()


def test_offsets_decay_at_their_rate(priors):
    prior = priors["ar_offsets"]
    parent, _, _ = family(prior)
    offsets = prior.space.slices["offsets"]
    parent[0, offsets] = 0.3
    for dt_s, frames in ((1 / 30, 1), (1 / 10, 3)):
        children = prior.sample_transition(np.repeat(parent, N, axis=0), dt_s, np.random.default_rng(3))[:, offsets]
        variance = 0.02**2 * sum(0.9 ** (2 * k) for k in range(frames))
        assert children.mean(axis=0) == pytest.approx(0.3 * 0.9**frames, abs=5 * np.sqrt(variance / N))
        assert children.var(axis=0) == pytest.approx(variance, rel=5 * np.sqrt(2 / N))


def test_offsets_start_in_their_stationary_distribution():
    """Offsets with the coefficient k and noise σ stay N(0, σ² / (1 − k²))."""
    prior, rng = AROffsets(Smooth(parameters=ARM), sigma=0.03, ar_coefficient=0.8), np.random.default_rng(0)
    state = prior.sample_initial(np.full(25, 0.1), N, rng)
    for states in (state, prior.sample_transition(state, 1 / 30, rng)):
        deviations = states[:, prior.space.slices["offsets"]].std(axis=0)
        assert deviations == pytest.approx(0.03 / 0.6, rel=5 / np.sqrt(2 * N))


def test_an_offset_changes_its_angle_alone(priors):
    prior = priors["ar_offsets"]
    parent, _, _ = family(prior)
    moved = parent.copy()
    moved[0, prior.space.names.index("left_elbow_flexion_offset")] += 0.1
    change = prior.pose(moved)[0] - prior.pose(parent)[0]
    assert change[prior.parameters.index("left_elbow_flexion")] == pytest.approx(0.1)
    assert np.count_nonzero(change) == 1


def test_the_density_of_a_fitted_rest_is_its_bases(priors):
    prior = priors["fitted_rest"]
    parent, _, children = family(prior)
    density = prior.capabilities.density.log_transition(parent, children, DT)
    np.testing.assert_array_equal(density, prior.base.log_transition(parent[:, :-1], children[:, :-1], DT))
    late = children + np.eye(len(prior.space))[-1] * 1e-6
    assert (prior.capabilities.density.log_transition(parent, late, DT) == -np.inf).all()


@pytest.fixture(scope="module")
def windows():
    return learn_windows(builtin_motions(n_subjects=2), angles=ARM, include_root=False, window_frames=4)


@pytest.mark.parametrize("wrapped", ["ar_offsets", "fitted_rest"])
def test_wrappers_sample_the_windows_of_an_implicit_base_given_the_pose(windows, wrapped):
    """Full steps, and steps whose windows are sampled again given the pose, have the same first and second moments."""
    base = Implicit(windows, beta=0.5, sigma_angles=0.1)
    prior = {"ar_offsets": AROffsets(base, sigma=0.05), "fitted_rest": FittedRest(base, lambda: TRAJECTORY)}[wrapped]
    density, dt_s = prior.capabilities.density, 1 / 30
    parent = prior.sample_initial(builtin_motions()[0].resampled(30.0).poses[0], 1, np.random.default_rng(0))
    n = N // 4
    parents = np.repeat(parent, n, axis=0)
    steps, incomplete = (prior.sample_transition(parents, dt_s, np.random.default_rng(seed)) for seed in (1, 2))
    dependent = np.setdiff1d(np.arange(len(prior.space)), density.free)
    assert len(dependent) == len(base.space) - 25
    incomplete[:, dependent] = np.nan
    completed = density.sample_dependent(parents, incomplete, dt_s, np.random.default_rng(3))
    assert (completed[:, density.free] == incomplete[:, density.free]).all()
    assert np.isfinite(density.log_transition(parents, incomplete, dt_s)).all()
    mean = steps.mean(axis=0)
    completed, steps = completed - mean, steps - mean
    for i in np.flatnonzero(steps.std(axis=0) > 1e-9):
        for moment, expected in ((completed, steps), (completed * completed[:, [i]], steps * steps[:, [i]])):
            error = np.sqrt((moment.var(axis=0) + expected.var(axis=0)) / n)
            assert (np.abs(moment.mean(axis=0) - expected.mean(axis=0)) <= 5.5 * error + 1e-9).all()


def test_offsets_have_the_deviations_of_the_models_discrepancy():
    """Angles without a discrepancy have a default. A discrepancy of three people is √3 as large for a new person."""
    base = Smooth()
    discrepancy = Discrepancy(
        ("neck_nod", "left_elbow_flexion"), np.array([[0.3], [0.0]]), np.array([0.4, 0.1]), AR_COEFFICIENTS, 3
    )
    base_with_discrepancy = SimpleNamespace(
        capabilities=replace(base.capabilities, discrepancy=discrepancy),
        space=base.space,
        parameters=base.parameters,
        sample_initial=base.sample_initial,
    )
    deviations = np.sqrt(3.0) * np.array([0.5, 0.1])
    for ar_coefficient, expected in ((0.9, [0.9, 0.9]), (None, AR_COEFFICIENTS)):
        prior = AROffsets(base_with_discrepancy, ar_coefficient=ar_coefficient)
        columns = [prior.space.names[prior.appended].index(f"{name}_offset") for name in discrepancy.angles]
        np.testing.assert_allclose(prior.ar_coefficients[columns], expected)
        np.testing.assert_allclose((prior.sigma / np.sqrt(1.0 - prior.ar_coefficients**2))[columns], deviations)
        others = np.delete(np.arange(len(prior.sigma)), columns)
        assert set(prior.sigma[others]) == {SIGMA}
        drawn = prior.sample_initial(np.zeros(25), 20_000, np.random.default_rng(1))[:, prior.appended]
        np.testing.assert_allclose(drawn[:, columns].std(axis=0), deviations, rtol=5 * np.sqrt(0.5 / 20_000))
    assert set(AROffsets(base_with_discrepancy, sigma=0.05).sigma) == {0.05}
    assert set(AROffsets(base).sigma) == {SIGMA}
