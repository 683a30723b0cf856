"""Postures are learned back, and what few were seen in says little of how they differ there."""

import numpy as np

from workbench.motion.models.linear_motion import FRAMES_A_PART, LEAST_RAD, fitted, learn_postures


def two_kinds(rng, n=1000):
    """Postures that are of one kind three times as often as of the other."""
    kinds = np.repeat([0, 1], [3 * n, n])
    means, deviations = np.array([[0.0, 0.0, 0.0], [1.0, -1.0, 0.5]]), np.array([[0.1, 0.2, 0.1], [0.3, 0.1, 0.1]])
    return means[kinds] + deviations[kinds] * rng.standard_normal((4 * n, 3))


def test_a_mixtures_own_postures_are_as_likely_as_by_what_made_them():
    model = learn_postures(two_kinds(np.random.default_rng(0)))
    fresh = two_kinds(np.random.default_rng(1))
    near_second = np.linalg.norm(model.means - [1.0, -1.0, 0.5], axis=1) < np.linalg.norm(model.means, axis=1)
    assert abs(model.weights[near_second].sum() - 0.25) < 0.02  # 4000 draws: 0.007
    told = np.logaddexp.reduce(model.log_parts(fresh), axis=1).mean()
    entropies = 0.5 * np.log(2.0 * np.pi * np.e * np.array([[0.1, 0.2, 0.1], [0.3, 0.1, 0.1]]) ** 2).sum(axis=1)
    exact = -entropies @ [0.75, 0.25] + np.array([0.75, 0.25]) @ np.log([0.75, 0.25])
    assert -0.2 < told - exact < 0.02  # 32 parts instead of 2, by 4000 draws


def test_a_part_that_few_were_in_is_nearly_as_wide_as_all_are():
    rng = np.random.default_rng(2)
    many, few = rng.standard_normal((20 * FRAMES_A_PART, 2)), 5.0 + 1e-4 * rng.standard_normal((FRAMES_A_PART, 2))
    kinds = np.repeat([0, 1], [len(many), len(few)])
    model = fitted(np.concatenate([many, few]), np.eye(2)[kinds])
    common = 20.0 / 21.0 * many.var(axis=0)  # the others do not vary
    assert np.allclose(np.diag(model.covariances[1]), 0.5 * common + LEAST_RAD**2, rtol=1e-3)
    assert np.allclose(np.diag(model.covariances[0]), many.var(axis=0), rtol=5e-3)
    assert np.allclose(model.weights, [20.0 / 21.0, 1.0 / 21.0])


def test_the_same_postures_are_the_same_model_and_few_have_few_parts():
    postures = two_kinds(np.random.default_rng(3), 20)
    first, second = learn_postures(postures), learn_postures(postures)
    assert len(first.weights) == 80 // FRAMES_A_PART
    assert np.array_equal(first.means, second.means)
    assert np.array_equal(first.covariances, second.covariances)
