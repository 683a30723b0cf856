"""A model's discrepancy from held-out people: the nearest pose, the low-rank covariance and known populations."""

from dataclasses import replace

import numpy as np
import pytest

from workbench.core.discrepancy import Discrepancy
from workbench.motion.models.model_discrepancy import (
    FIT_SIGMA_RAD,
    MAX_AR_COEFFICIENT,
    learn_discrepancy,
    low_rank,
    nearest_angles,
)
from workbench.motion.models.store import Provenance, load, save
from workbench.motion.models.training import walking_model

ANGLES = ("a", "b", "c", "d", "e")
T = 32
DEVIATIONS = np.radians([1.0, 4.0, 8.0, 0.1, 0.1])


def population(n_people, deviations, seed, per_frame=False, n_cycles=3):
    """Return cycles of people who differ along one component and by offsets, constant or of every frame; two large
    angles determine the phase."""
    rng = np.random.default_rng(seed)
    phases = 2.0 * np.pi * np.arange(T) / T
    mean = np.stack([*np.zeros((3, T)), 3.0 * np.sin(phases), 3.0 * np.cos(phases)], axis=1)
    component = np.stack([np.sin(phases), np.cos(2 * phases), *np.zeros((3, T))], axis=1)
    scores = rng.standard_normal((n_people, n_cycles))
    size = (n_people, n_cycles, T, 5) if per_frame else (n_people, 1, 1, 5)
    curves = mean + scores[..., None, None] * component + deviations * rng.standard_normal(size)
    people = np.repeat([f"person {k}" for k in range(n_people)], n_cycles)
    return curves.reshape(-1, T, 5), np.full(n_people * n_cycles, 1.0), tuple(people)


def test_the_nearest_angles_are_those_of_a_ridge_regression_at_the_best_phase():
    rng = np.random.default_rng(1)
    mean, basis, angles = rng.standard_normal((5, 3)), rng.standard_normal((2, 5, 3)), rng.standard_normal((4, 3))
    for target, nearest in zip(angles, nearest_angles(mean, basis, angles), strict=True):
        fits = []
        for phase in range(5):
            rows = np.vstack([basis[:, phase].T / FIT_SIGMA_RAD, np.eye(2)])
            right = np.concatenate([(target - mean[phase]) / FIT_SIGMA_RAD, np.zeros(2)])
            alpha, cost = np.linalg.lstsq(rows, right, rcond=None)[:2]
            fits.append((float(cost[0]), mean[phase] + alpha @ basis[:, phase]))
        np.testing.assert_allclose(nearest, min(fits, key=lambda fit: fit[0])[1], atol=1e-9)


def test_the_low_rank_part_has_the_first_axes_and_the_diagonal_is_exact():
    rng = np.random.default_rng(2)
    factors = rng.standard_normal((6, 2)) * [3.0, 1.0]
    covariance = factors @ factors.T + np.diag(np.arange(1.0, 7.0) * 1e-3)
    loadings, rest = low_rank(covariance, 0.99)
    assert loadings.shape == (6, 2)
    approximation = loadings @ loadings.T + np.diag(rest**2)
    np.testing.assert_allclose(np.diagonal(approximation), np.diagonal(covariance), rtol=1e-12)
    np.testing.assert_allclose(approximation, covariance, atol=0.02)
    loadings, rest = low_rank(np.eye(6), 0.1)
    np.testing.assert_allclose(loadings @ loadings.T + np.diag(rest**2), np.eye(6), atol=1e-12)


def test_a_constant_offset_of_people_is_estimated_with_its_size():
    discrepancy = learn_discrepancy(ANGLES, *population(60, DEVIATIONS, 3), n_components=1)
    assert discrepancy.std[2] == pytest.approx(DEVIATIONS[2], rel=0.25)
    assert discrepancy.ar_coefficients[2] > 0.97
    assert discrepancy.n_subjects == 60
    assert discrepancy.angles == ANGLES


def test_independent_offsets_of_frames_have_a_small_coefficient():
    discrepancy = learn_discrepancy(ANGLES, *population(12, DEVIATIONS, 4, per_frame=True, n_cycles=6), n_components=1)
    assert discrepancy.std[2] == pytest.approx(DEVIATIONS[2], rel=0.2)
    assert discrepancy.ar_coefficients[2] < 0.3
    assert (discrepancy.ar_coefficients <= MAX_AR_COEFFICIENT).all()


def test_people_have_equal_weights_and_are_held_out():
    """The discrepancy of one different person is visible only in a model without that person's cycles."""
    curves, durations, people = population(8, np.full(5, np.radians(0.1)), 5)
    different = np.array(people) == "person 3"
    curves[different, :, 2] += 0.5
    held_out = learn_discrepancy(ANGLES, curves, durations, people, n_components=2).std[2]
    assert held_out == pytest.approx(0.5 / np.sqrt(8), rel=0.2)
    mixed = learn_discrepancy(ANGLES, curves, durations, tuple("ab" * (len(people) // 2)), n_components=2)
    assert mixed.std[2] < 0.5 * held_out


def test_one_person_or_too_few_cycles_give_no_discrepancy():
    curves, durations, people = population(2, DEVIATIONS, 6)
    assert learn_discrepancy(ANGLES, curves, durations, ("one",) * len(people), n_components=1) is None
    assert learn_discrepancy(ANGLES, curves, durations, people, n_components=3) is None


def test_the_covariance_root_is_zero_for_unknown_angles():
    discrepancy = Discrepancy(
        ("a", "b", "c"), np.array([[0.1], [0.2], [0.0]]), np.array([0.0, 0.0, 0.3]), np.zeros(3), 4
    )
    root = discrepancy.covariance_root(("x", "c", "a"))
    np.testing.assert_allclose(root @ root.T, [[0, 0, 0], [0, 0.09, 0], [0, 0, 0.01]], atol=1e-15)
    np.testing.assert_allclose(discrepancy.std, [0.1, 0.2, 0.3])


def test_a_model_is_stored_with_and_without_discrepancy(tmp_path):
    model = walking_model(cache=str(tmp_path))
    loaded = load(type(model), next((tmp_path / "models").glob("walking-*.h5")))
    assert loaded.discrepancy.n_subjects == 12
    np.testing.assert_array_equal(loaded.discrepancy.loadings, model.discrepancy.loadings)
    np.testing.assert_array_equal(loaded.discrepancy.residual_std, model.discrepancy.residual_std)
    assert loaded.discrepancy.angles == model.discrepancy.angles
    save(tmp_path / "m.h5", replace(model, discrepancy=None), Provenance({}, {}, ()))
    assert load(type(model), tmp_path / "m.h5").discrepancy is None
