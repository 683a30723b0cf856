"""Which activity coefficients belong to, against Gaussians; measurements without a group, against learning anew."""

import numpy as np
import pytest
from scipy.stats import multivariate_normal

from workbench.motion.models.activities import (
    ActivityModel,
    accuracy_left_out,
    classify,
    error_left_out_deg,
    learn_activities,
    mean_rates_hz,
)
from workbench.motion.models.activity_cycles import ActivityCycles
from workbench.utils.errors import InputError

ANGLES = ("left_hip_flexion", "left_knee_flexion")
T, RANK = 16, 4


def model_of(scores, activities, rates=None):
    n, d = scores.shape
    rates = np.ones(n) if rates is None else rates
    curves = np.zeros((T, 1)), np.zeros((d, T, 1))
    explained = np.ones(min(n, T))
    return ActivityModel(("a",), *curves, np.ones(d), explained, scores, tuple(activities), ("c",) * n, rates)


def cycles(n=40, apart=2.0, seed=0):
    """Cycles that vary in RANK ways, walks and runs apart in the first; two of a clip."""
    rng = np.random.default_rng(seed)
    basis = np.linalg.qr(rng.normal(size=(T * len(ANGLES), RANK)))[0].T
    runs = np.arange(n) % 4 < 2
    coefficients = rng.normal(size=(n, RANK)) * [1.0, 1.5, 0.7, 0.5]
    coefficients[:, 0] += apart * runs
    curves = (coefficients @ basis).reshape(n, T, -1)
    labels = tuple(np.where(runs, "run", "walk").tolist())
    return ActivityCycles(ANGLES, curves, rng.uniform(0.6, 1.2, n), labels, tuple(f"clip_{k // 2}" for k in range(n)))


def test_probabilities_are_those_of_gaussians_with_one_covariance():
    rng = np.random.default_rng(0)
    mix = np.array([[1.0, 0.6, 0.0], [0.0, 0.8, -0.3], [0.0, 0.0, 0.5]])
    means = {"run": [2.0, 0.0, 0.0], "skip": [0.0, 2.0, 1.0], "walk": [-1.0, -1.0, 0.0]}
    names = [name for name in means for _ in range(50)]
    samples = [np.array(mean) + rng.normal(size=(50, 3)) @ mix for mean in means.values()]
    scores = np.concatenate(samples)
    alpha = rng.normal(size=(5, 7, 3))
    found = classify(model_of(scores, names), alpha)
    assert found.activities == ("run", "skip", "walk")
    assert found.probabilities.shape == (5, 7, 3)
    assert found.probabilities.sum(axis=-1) == pytest.approx(1.0)
    covariance = np.mean([np.cov(sample.T, bias=True) for sample in samples], axis=0) + 0.1**2 * np.eye(3)
    density = np.stack([multivariate_normal(sample.mean(axis=0), covariance).pdf(alpha) for sample in samples], axis=-1)
    assert found.probabilities == pytest.approx(density / density.sum(axis=-1, keepdims=True), abs=1e-9)
    np.testing.assert_array_equal(found.labels, np.array(found.activities)[density.argmax(axis=-1)])


def test_coefficients_far_away_and_examples_without_spread_still_have_probabilities():
    scores = np.repeat([[1.0, 0.0], [-1.0, 0.0]], 3, axis=0)
    found = classify(model_of(scores, ["run"] * 3 + ["walk"] * 3), np.array([[1e4, 0.0], [-3.0, 1e4], [0.2, 0.0]]))
    assert np.isfinite(found.probabilities).all()
    assert found.labels.tolist() == ["run", "walk", "run"]


def test_the_speed_of_the_phase_is_the_mean_of_the_examples():
    model = model_of(np.zeros((4, 1)), ["run", "walk", "run", "walk"], np.array([1.2, 0.8, 1.6, 1.0]))
    assert mean_rates_hz(model) == pytest.approx({"run": 1.4, "walk": 0.9})


@pytest.mark.parametrize("d", [1, 2, 3])
def test_without_a_clip_is_as_learning_anew(d):
    every = cycles()
    right, squares = [], []
    for clip in sorted(set(every.sources)):
        out = np.array([source == clip for source in every.sources])
        model = learn_activities(every.only(~out), angles=ANGLES, n_components=d)
        rows, basis = (every.curves[out] - model.mean).reshape(out.sum(), -1), model.components.reshape(d, -1)
        alpha = rows @ basis.T / model.scales
        right += (classify(model, alpha).labels == np.array(every.only(out).activities)).tolist()
        squares += list((rows - rows @ basis.T @ basis) ** 2)
    assert accuracy_left_out(every, every.sources, d) == np.mean(right)
    assert error_left_out_deg(every, every.sources, d) == pytest.approx(np.degrees(np.sqrt(np.mean(squares))), rel=1e-9)
    assert 0.5 < np.mean(right) <= 1.0


def test_an_activity_in_one_group_only_is_never_told_right():
    every = cycles()
    assert accuracy_left_out(every, every.activities, 2) == 0.0


@pytest.mark.parametrize(("groups", "d"), [(["one"] * 40, 2), (["a"] * 38 + ["b"] * 2, 2), (["a", "b"] * 20, 0)])
def test_too_few_groups_or_examples_are_refused(groups, d):
    with pytest.raises(InputError, match="two groups"):
        accuracy_left_out(cycles(), groups, d)
