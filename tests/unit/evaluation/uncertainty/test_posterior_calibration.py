"""Coverage, ranks and scores of particles against closed forms."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.stats import norm
from single_steps import BODY, SKELETON, standing, step_of

from workbench.body.kinematics import joints
from workbench.core.frame import Truth
from workbench.evaluation.errors.pose_errors import step_errors
from workbench.evaluation.uncertainty.intervals import weighted_quantiles
from workbench.evaluation.uncertainty.posterior_calibration import (
    covered,
    crps,
    gaussian_nll,
    moments,
    ranks,
    weight_below,
)

N = 20_001
UNIFORM = np.full(N, 1.0 / N)
NORMAL = norm.ppf((np.arange(N) + 0.5) / N)[:, None] * [1.0, 3.0] + [0.0, 10.0]
"""Quantiles of N(0, 1) and N(10, 3²) with equal weights, whose means are accurate to about 1/N."""


def weight_below_reference(values, weights, truth):
    """Return `weight_below` in plain NumPy."""
    return np.stack([weights @ (values < truth), weights @ (values == truth)])


def crps_reference(values, weights, truth):
    """Return the CRPS by its definition, over all pairs of particles."""
    spread = np.array([weights @ np.abs(np.subtract.outer(x, x)) @ weights for x in values.T])
    return weights @ np.abs(values - truth) - 0.5 * spread


def ranks_of(values, weights, truth):
    return ranks(weight_below(values, weights, truth))


@pytest.mark.parametrize("z", [-2.0, 0.0, 0.7])
def test_crps_and_nll_of_normal_particles(z):
    truth = np.array([z, 10.0 + 3.0 * z])
    closed = z * (2.0 * norm.cdf(z) - 1.0) + 2.0 * norm.pdf(z) - 1.0 / np.sqrt(np.pi)  # Gneiting & Raftery, eq. 20
    np.testing.assert_allclose(crps(NORMAL, UNIFORM, truth), closed * np.array([1.0, 3.0]), rtol=1e-3)
    expected = -norm.logpdf(truth, loc=[0.0, 10.0], scale=[1.0, 3.0])
    np.testing.assert_allclose(gaussian_nll(*moments(NORMAL, UNIFORM), truth), expected, atol=1e-3)


def test_the_nll_of_equal_particles_is_infinite():
    equal = np.ones((4, 2))
    assert gaussian_nll(*moments(equal, np.full(4, 0.25)), np.array([1.0, 2.0])).tolist() == [-np.inf, np.inf]


def test_truths_between_the_quantiles_are_covered():
    below = weight_below(NORMAL, UNIFORM, np.array([0.6, 10.0 - 3.0 * 0.7]))
    inside = covered(below, (0.5, 0.9))  # ±0.674 σ, ±1.645 σ
    assert inside.tolist() == [[True, False], [True, True]]


def test_a_rank_is_the_weight_below_the_truth_plus_half_of_ties():
    values = np.array([[0.0], [1.0], [2.0], [1.0]])
    weights = np.array([0.1, 0.2, 0.3, 0.4])
    assert ranks_of(values, weights, np.array([1.0])) == pytest.approx(0.1 + 0.3)
    assert ranks_of(values, weights, np.array([1.5])) == pytest.approx(0.7)


def test_ranks_are_uniform_for_the_true_posterior_only():
    rng = np.random.default_rng(1)
    truths = rng.standard_normal((2000, 1))
    uniform = np.full(200, 1 / 200)
    histograms = {
        scale: np.histogram(
            np.concatenate([ranks_of(scale * rng.standard_normal((200, 1)), uniform, y) for y in truths]),
            10,
            (0.0, 1.0),
        )[0]
        for scale in (1.0, 0.5, 2.0)
    }
    assert all(counts.sum() == 2000 for counts in histograms.values())
    # a bin's count is binomial, 200 ± 13.4; six standard deviations
    assert np.abs(histograms[1.0] - 200).max() < 6 * 13.4
    assert min(histograms[0.5][0], histograms[0.5][-1]) > 400  # overconfident: U-shaped
    assert max(histograms[2.0][0], histograms[2.0][-1]) < 60  # underconfident: humped


def test_a_step_reports_calibration_of_pose_or_joints():
    rng = np.random.default_rng(0)
    spread = 0.05 * rng.standard_normal((2000, 25))
    spread[:, 5] = 0.0  # fixed at a wrong value, which is not covered
    pose = standing()
    true = pose.copy()
    true[:12] += 0.05 * 1.0  # one standard deviation: outside the 50 % interval, inside the 90 % interval
    errors = step_errors(step_of(pose + spread, Truth(pose=true, joints=joints(SKELETON, true[None])[0])), BODY)
    assert errors["coverage_50"] == pytest.approx(13 / 25)
    assert errors["coverage_90"] == pytest.approx(24 / 25)
    off = 1.0 * (2.0 * norm.cdf(1.0) - 1.0) + 2.0 * norm.pdf(1.0) - 1.0 / np.sqrt(np.pi)
    on = 2.0 * norm.pdf(0.0) - 1.0 / np.sqrt(np.pi)
    # scores of 2000 samples are accurate to a few per cent
    assert errors["crps_mm"] == pytest.approx(50.0 * off, rel=0.05)
    assert errors["crps_deg"] == pytest.approx(np.degrees(0.05 * (8 * off + 13 * on + 1.0) / 22), rel=0.05)
    # of N(0, 0.05²): 11 parameters differ by one standard deviation, 13 by none
    assert errors["nll"] == pytest.approx(np.log(0.05 * np.sqrt(2.0 * np.pi)) + 0.5 * 11 / 24, abs=0.02)
    assert "coverage_90_joints" not in errors
    shift = 0.05 * rng.standard_normal((2000, 1)) * np.eye(25)[0]
    shifted = joints(SKELETON, (pose + 0.05 * np.eye(25)[0])[None])[0]
    shifted[4] = np.nan
    errors = step_errors(step_of(pose + shift, Truth(joints=shifted)), BODY)
    assert errors["crps_joints_mm"] == pytest.approx(50.0 * off / 3.0, rel=0.05)  # one coordinate of three moves
    assert errors["coverage_50_joints"] == pytest.approx(2 / 3)  # all particles agree with the truth in the others
    assert errors["coverage_90_joints"] == 1.0


def test_one_particle_with_all_the_weight_has_no_nll():
    pose = standing()
    step = step_of(pose + 0.05 * np.random.default_rng(0).standard_normal((3, 25)), Truth(pose=pose))
    degenerate = replace(step, log_weights=np.array([0.0, -np.inf, -np.inf]))
    assert "nll" in step_errors(step, BODY)
    assert "nll" not in step_errors(degenerate, BODY)


def weighted(n, seed):
    """Return values (n, 4) with ties and an outlier, weights with zeros, and truths inside, on a particle, outside."""
    rng = np.random.default_rng(seed)
    values = rng.standard_normal((n, 4)).round(1)
    values[:, 0] = 0.01 * rng.standard_normal(n)
    values[0, 0] = 30.0
    weights = rng.random(n) * (rng.random(n) < 0.8)
    return values, weights / weights.sum(), np.array([0.05, values[weights.argmax(), 1], 9.0, values[:, 3].min()])


@pytest.mark.parametrize("n", [3, 50, 1000])
def test_kernels_agree_with_plain_numpy(n):
    values, weights, truth = weighted(n, seed=n)
    expected = crps_reference(values, weights, truth)
    np.testing.assert_allclose(crps(values, weights, truth), expected, rtol=1e-12, atol=1e-12)
    below = weight_below_reference(values, weights, truth)
    np.testing.assert_allclose(weight_below(values, weights, truth), below, rtol=0.0, atol=1e-13)
    assert below[1, 1] > 0.0  # a tie with the heaviest particle
    mean = weights @ values
    np.testing.assert_allclose(moments(values, weights), (mean, weights @ (values - mean) ** 2), rtol=1e-12, atol=1e-14)


@pytest.mark.parametrize("n", [20, 50, 1000])
def test_coverage_is_that_of_the_weighted_quantiles(n):
    values, weights, truth = weighted(n, seed=n)
    low, high = weighted_quantiles(values, weights, (0.05, 0.95))
    (inside,) = covered(weight_below(values, weights, truth), (0.9,))
    assert inside.tolist() == ((low <= truth) & (truth <= high)).tolist()
    assert 0 < inside.sum() < 4
