"""What a model misses of people left out: the nearest pose, the low-rank covariance, and a population that is known."""

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
MISSED = np.radians([1.0, 4.0, 8.0, 0.1, 0.1])


def population(n_people, missed, seed, per_frame=False, n_cycles=3):
    """Cycles of people who differ along one component, and by offsets, their own or those of every frame; two large
    angles tell the phase."""
    rng = np.random.default_rng(seed)
    phases = 2.0 * np.pi * np.arange(T) / T
    mean = np.stack([*np.zeros((3, T)), 3.0 * np.sin(phases), 3.0 * np.cos(phases)], axis=1)
    component = np.stack([np.sin(phases), np.cos(2 * phases), *np.zeros((3, T))], axis=1)
    scores = rng.standard_normal((n_people, n_cycles))
    size = (n_people, n_cycles, T, 5) if per_frame else (n_people, 1, 1, 5)
    curves = mean + scores[..., None, None] * component + missed * rng.standard_normal(size)
    people = np.repeat([f"person {k}" for k in range(n_people)], n_cycles)
    return curves.reshape(-1, T, 5), np.full(n_people * n_cycles, 1.0), tuple(people)


def test_the_nearest_angles_are_those_of_a_ridge_regression_at_the_best_phase():
    rng = np.random.default_rng(1)
    mean, basis, angles = rng.standard_normal((5, 3)), rng.standard_normal((2, 5, 3)), rng.standard_normal((4, 3))
    for wanted, found in zip(angles, nearest_angles(mean, basis, angles), strict=True):
        fits = []
        for phase in range(5):
            rows = np.vstack([basis[:, phase].T / FIT_SIGMA_RAD, np.eye(2)])
            right = np.concatenate([(wanted - mean[phase]) / FIT_SIGMA_RAD, np.zeros(2)])
            alpha, cost = np.linalg.lstsq(rows, right, rcond=None)[:2]
            fits.append((float(cost[0]), mean[phase] + alpha @ basis[:, phase]))
        np.testing.assert_allclose(found, min(fits, key=lambda fit: fit[0])[1], atol=1e-9)


def test_the_low_rank_part_has_the_first_axes_and_the_diagonal_is_exact():
    rng = np.random.default_rng(2)
    factors = rng.standard_normal((6, 2)) * [3.0, 1.0]
    covariance = factors @ factors.T + np.diag(np.arange(1.0, 7.0) * 1e-3)
    loadings, rest = low_rank(covariance, 0.99)
    assert loadings.shape == (6, 2)
    found = loadings @ loadings.T + np.diag(rest**2)
    np.testing.assert_allclose(np.diagonal(found), np.diagonal(covariance), rtol=1e-12)
    np.testing.assert_allclose(found, covariance, atol=0.02)
    loadings, rest = low_rank(np.eye(6), 0.1)
    np.testing.assert_allclose(loadings @ loadings.T + np.diag(rest**2), np.eye(6), atol=1e-12)


def test_a_bearing_of_ones_own_is_found_as_large_as_it_is_and_stays():
    found = learn_discrepancy(ANGLES, *population(60, MISSED, 3), n_components=1)
    assert found.std[2] == pytest.approx(MISSED[2], rel=0.25)
    assert found.ar_coefficients[2] > 0.97
    assert found.n_subjects == 60
    assert found.angles == ANGLES


def test_what_is_new_in_every_frame_is_not_kept():
    found = learn_discrepancy(ANGLES, *population(12, MISSED, 4, per_frame=True, n_cycles=6), n_components=1)
    assert found.std[2] == pytest.approx(MISSED[2], rel=0.2)
    assert found.ar_coefficients[2] < 0.3
    assert (found.ar_coefficients <= MAX_AR_COEFFICIENT).all()


def test_people_count_alike_and_are_not_learned_from_themselves():
    """One strange person among many usual ones: seen only as long as their own cycles are left out of their model."""
    curves, durations, people = population(8, np.full(5, np.radians(0.1)), 5)
    strange = np.array(people) == "person 3"
    curves[strange, :, 2] += 0.5
    alone = learn_discrepancy(ANGLES, curves, durations, people, n_components=2).std[2]
    assert alone == pytest.approx(0.5 / np.sqrt(8), rel=0.2)
    mixed = learn_discrepancy(ANGLES, curves, durations, tuple("ab" * (len(people) // 2)), n_components=2)
    assert mixed.std[2] < 0.5 * alone


def test_one_person_or_few_cycles_of_others_tell_nothing():
    curves, durations, people = population(2, MISSED, 6)
    assert learn_discrepancy(ANGLES, curves, durations, ("one",) * len(people), n_components=1) is None
    assert learn_discrepancy(ANGLES, curves, durations, people, n_components=3) is None


def test_a_pose_has_rows_of_the_angles_it_knows():
    missed = Discrepancy(("a", "b", "c"), np.array([[0.1], [0.2], [0.0]]), np.array([0.0, 0.0, 0.3]), np.zeros(3), 4)
    root = missed.covariance_root(("x", "c", "a"))
    np.testing.assert_allclose(root @ root.T, [[0, 0, 0], [0, 0.09, 0], [0, 0, 0.01]], atol=1e-15)
    np.testing.assert_allclose(missed.std, np.sqrt(np.diagonal(missed.covariance)))


def test_it_is_stored_with_the_model(tmp_path):
    model = walking_model(cache=str(tmp_path))
    path = next((tmp_path / "models").glob("walking-*.h5"))
    again = load(type(model), path)
    assert again.discrepancy.n_subjects == 12
    np.testing.assert_array_equal(again.discrepancy.covariance, model.discrepancy.covariance)
    assert again.discrepancy.angles == model.discrepancy.angles


def test_a_model_of_which_nothing_is_known_is_stored_too(tmp_path):
    model = replace(walking_model(cache=str(tmp_path)), discrepancy=None)
    save(tmp_path / "m.h5", model, Provenance({}, {}, ()))
    assert load(type(model), tmp_path / "m.h5").discrepancy is None
