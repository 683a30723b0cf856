"""The motion model of several activities: PCA of synthetic components, derivatives, and classes by Gaussians."""

import h5py
import numpy as np
import pytest
from scipy.stats import multivariate_normal

from workbench.motion.models.activities import (
    ActivityModel,
    classify,
    held_out_accuracy,
    held_out_error_deg,
    learn_activities,
    mean_rates_hz,
)
from workbench.motion.models.activity_cycles import ActivityCycles
from workbench.motion.models.store import Provenance, load, save
from workbench.utils.errors import InputError

T, ANGLES = 24, ("left_hip_flexion", "left_knee_flexion", "right_hip_flexion", "neck_turn")
PROVENANCE = Provenance({"a.bvh": "12"}, {"variance": 0.9}, ("free",))


def synthetic_cycles(n=30, seed=0):
    """Return cycles that vary along three curves with deviations 3, 1 and 0.3, the curves, and the coefficients."""
    rng = np.random.default_rng(seed)
    phases = 2.0 * np.pi * np.arange(T)[:, None] / T
    orders, starts = rng.integers(1, 4, (4, len(ANGLES))), rng.uniform(0.0, 6.0, (4, len(ANGLES)))
    mean, *curves = np.cos(orders[:, None] * phases + starts[:, None])
    basis = np.linalg.qr(np.stack(curves).reshape(3, -1).T)[0].T
    coefficients = rng.normal(size=(n, 3)) * [3.0, 1.0, 0.3]
    values = mean + (coefficients @ basis).reshape(n, T, -1)
    activities = tuple("run" if a > 0.0 else "walk" for a in coefficients[:, 0])
    sources = tuple(f"clip_{k // 2:02d}" for k in range(n))
    return ActivityCycles(ANGLES, values, rng.uniform(0.6, 1.2, n), activities, sources), basis, coefficients


@pytest.fixture(scope="module")
def model():
    return learn_activities(synthetic_cycles()[0], angles=ANGLES, n_components=3)


def test_the_components_span_the_true_ones(model):
    _, basis, coefficients = synthetic_cycles()
    rows = model.components.reshape(3, -1)
    assert rows @ rows.T == pytest.approx(np.eye(3), abs=1e-12)
    assert basis - basis @ rows.T @ rows == pytest.approx(0.0, abs=1e-9)  # the same space
    assert model.scales**2 == pytest.approx(np.linalg.eigvalsh(np.cov(coefficients.T))[::-1])
    assert model.explained[2:] == pytest.approx(1.0)
    assert model.explained[:2] == pytest.approx(np.cumsum(model.scales[:2] ** 2) / np.sum(model.scales**2))


def test_scores_are_whitened_and_reconstruct_every_example(model):
    cycles, *_ = synthetic_cycles()
    assert np.cov(model.scores.T) == pytest.approx(np.eye(3), abs=1e-9)
    reconstructed = model.angles_at(model.scores[:, None], np.arange(T) / T)
    assert reconstructed == pytest.approx(cycles.curves, abs=1e-9)
    assert model.cycle_rate_hz == pytest.approx(1.0 / cycles.durations_s)
    assert model.activities == cycles.activities


def test_the_number_of_components_is_the_fewest_that_explain_more():
    cycles, *_ = synthetic_cycles()
    full = learn_activities(cycles, angles=ANGLES, n_components=3).explained
    for d in (1, 2, 3):
        variance = (full[d - 1] + (full[d - 2] if d > 1 else 0.0)) / 2.0
        assert len(learn_activities(cycles, angles=ANGLES, variance=variance).scales) == d
    chosen = learn_activities(cycles, angles=["left_knee_flexion"])
    assert chosen.angles == ("left_knee_flexion",)
    assert chosen.mean.shape == (T, 1)


@pytest.mark.parametrize("shape", [(), (7,), (2, 3)])
def test_derivatives_agree_with_finite_differences(model, shape):
    rng = np.random.default_rng(1)
    alpha, mu = rng.normal(size=(*shape, 3)), rng.uniform(-2.0, 3.0, shape)
    by_alpha, by_mu = model.jacobian_at(alpha, mu)
    assert by_alpha.shape == (*shape, len(ANGLES), 3)
    h = 1e-5
    moved = (model.angles_at(alpha, mu + h) - model.angles_at(alpha, mu - h)) / (2.0 * h)
    # third derivative of a cubic spline of curves with 3 waves a cycle: (6π)³ h² / 6 = 1e-7 of about 20 rad a cycle
    assert by_mu == pytest.approx(moved, abs=2e-6)
    for k, unit in enumerate(np.eye(3)):
        step = model.angles_at(alpha + unit, mu) - model.angles_at(alpha, mu)
        assert by_alpha[..., k] == pytest.approx(step, abs=1e-12)  # linear


def test_one_style_applies_to_all_frames_and_the_phase_is_cyclic(model):
    alpha, mu = np.array([0.5, -1.0, 2.0]), np.linspace(0.0, 0.99, 9)
    repeated = np.tile(alpha, (9, 1))
    np.testing.assert_array_equal(model.angles_at(alpha, mu), model.angles_at(repeated, mu))
    for jacobian, expected in zip(model.jacobian_at(alpha, mu), model.jacobian_at(repeated, mu), strict=True):
        np.testing.assert_array_equal(jacobian, expected)
    assert model.angles_at(alpha, mu + 3.0) == pytest.approx(model.angles_at(alpha, mu), abs=1e-12)
    ends = [model.jacobian_at(alpha, np.array(phase))[1] for phase in (1e-9, 1.0 - 1e-9)]
    assert ends[0] == pytest.approx(ends[1], abs=1e-5)  # smooth where the cycle closes


@pytest.mark.parametrize("content", [None, b"", b"not hdf5 at all", "no activities"])
def test_files_that_hold_no_model_are_rejected(tmp_path, model, content):
    path = tmp_path / "m.h5"
    if content == "no activities":
        save(path, model, PROVENANCE)
        with h5py.File(path, "r+") as file:
            del file["activities"]
    elif content is not None:
        path.write_bytes(content)
    with pytest.raises(InputError, match=r"m\.h5"):
        load(ActivityModel, path)


LEGS = ("left_hip_flexion", "left_knee_flexion")
N_PHASES, RANK = 16, 4


def model_of(scores, activities, rates=None):
    n, d = scores.shape
    rates = np.ones(n) if rates is None else rates
    curves = np.zeros((N_PHASES, 1)), np.zeros((d, N_PHASES, 1))
    explained = np.ones(min(n, N_PHASES))
    return ActivityModel(("a",), *curves, np.ones(d), explained, scores, tuple(activities), rates)


def walks_and_runs(n=40, distance=2.0, seed=0):
    """Return cycles, two per clip, that vary along RANK curves; walks and runs differ by a distance along the first."""
    rng = np.random.default_rng(seed)
    basis = np.linalg.qr(rng.normal(size=(N_PHASES * len(LEGS), RANK)))[0].T
    runs = np.arange(n) % 4 < 2
    coefficients = rng.normal(size=(n, RANK)) * [1.0, 1.5, 0.7, 0.5]
    coefficients[:, 0] += distance * runs
    curves = (coefficients @ basis).reshape(n, N_PHASES, -1)
    labels = tuple(np.where(runs, "run", "walk").tolist())
    return ActivityCycles(LEGS, curves, rng.uniform(0.6, 1.2, n), labels, tuple(f"clip_{k // 2}" for k in range(n)))


def test_probabilities_are_those_of_gaussians_with_one_covariance():
    rng = np.random.default_rng(0)
    mix = np.array([[1.0, 0.6, 0.0], [0.0, 0.8, -0.3], [0.0, 0.0, 0.5]])
    means = {"run": [2.0, 0.0, 0.0], "skip": [0.0, 2.0, 1.0], "walk": [-1.0, -1.0, 0.0]}
    names = [name for name in means for _ in range(50)]
    samples = [np.array(mean) + rng.normal(size=(50, 3)) @ mix for mean in means.values()]
    scores = np.concatenate(samples)
    alpha = rng.normal(size=(5, 7, 3))
    result = classify(model_of(scores, names), alpha)
    assert result.activities == ("run", "skip", "walk")
    assert result.probabilities.shape == (5, 7, 3)
    assert result.probabilities.sum(axis=-1) == pytest.approx(1.0)
    covariance = np.mean([np.cov(sample.T, bias=True) for sample in samples], axis=0) + 0.1**2 * np.eye(3)
    density = np.stack([multivariate_normal(sample.mean(axis=0), covariance).pdf(alpha) for sample in samples], axis=-1)
    assert result.probabilities == pytest.approx(density / density.sum(axis=-1, keepdims=True), abs=1e-9)
    np.testing.assert_array_equal(result.labels, np.array(result.activities)[density.argmax(axis=-1)])


def test_distant_coefficients_and_identical_examples_have_probabilities():
    scores = np.repeat([[1.0, 0.0], [-1.0, 0.0]], 3, axis=0)
    result = classify(model_of(scores, ["run"] * 3 + ["walk"] * 3), np.array([[1e4, 0.0], [-3.0, 1e4], [0.2, 0.0]]))
    assert np.isfinite(result.probabilities).all()
    assert result.labels.tolist() == ["run", "walk", "run"]


def test_cycle_rates_are_means_of_the_examples():
    model = model_of(np.zeros((4, 1)), ["run", "walk", "run", "walk"], np.array([1.2, 0.8, 1.6, 1.0]))
    assert mean_rates_hz(model) == pytest.approx({"run": 1.4, "walk": 0.9})


@pytest.mark.parametrize("d", [1, 2, 3])
def test_held_out_results_are_those_of_models_learned_without_the_clip(d):
    cycles = walks_and_runs()
    correct, squares = [], []
    for clip in sorted(set(cycles.sources)):
        held_out = np.array([source == clip for source in cycles.sources])
        model = learn_activities(cycles.only(~held_out), angles=LEGS, n_components=d)
        rows, basis = (
            (cycles.curves[held_out] - model.mean).reshape(held_out.sum(), -1),
            model.components.reshape(d, -1),
        )
        alpha = rows @ basis.T / model.scales
        correct += (classify(model, alpha).labels == np.array(cycles.only(held_out).activities)).tolist()
        squares += list((rows - rows @ basis.T @ basis) ** 2)
    assert held_out_accuracy(cycles, cycles.sources, d) == np.mean(correct)
    assert held_out_error_deg(cycles, cycles.sources, d) == pytest.approx(
        np.degrees(np.sqrt(np.mean(squares))), rel=1e-9
    )
    assert 0.5 < np.mean(correct) <= 1.0


def test_an_activity_of_a_single_group_is_never_classified_correctly():
    cycles = walks_and_runs()
    assert held_out_accuracy(cycles, cycles.activities, 2) == 0.0


@pytest.mark.parametrize(("groups", "d"), [(["one"] * 40, 2), (["a"] * 38 + ["b"] * 2, 2), (["a", "b"] * 20, 0)])
def test_too_few_groups_or_examples_are_rejected(groups, d):
    with pytest.raises(InputError, match="two groups"):
        held_out_accuracy(walks_and_runs(), groups, d)
