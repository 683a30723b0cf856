"""Paired tests: their level for unchanged code, and their power for the reported smallest change."""

from itertools import product

import numpy as np
import pytest
import recorded
from recording_steps import errors, steps, without_images
from scipy import stats

from workbench.recording.read.reader import read
from workbench.results.check.seeds import compare_paired, differences, energy_test, holm, p_of_mean, paired_interval


def rejection_rate(rejects, n):
    """Return the fraction of n random cases that a test rejects."""
    rng = np.random.default_rng(0)
    return np.mean([rejects(rng) for _ in range(n)])


@pytest.mark.parametrize("n", [2, 8])
def test_the_p_value_of_a_mean_is_students(n):
    d = np.random.default_rng(n).standard_normal(n)
    t = d.mean() / (d.std(ddof=1) / np.sqrt(n))
    assert p_of_mean(d) == pytest.approx(2.0 * stats.t.sf(abs(t), n - 1))


@pytest.mark.parametrize("n", [3, 8, 11])
def test_the_p_value_of_counts_is_that_of_all_exchanges(n):
    """The level of a permutation test is exact, also for differences that are often equal."""
    signs = np.array(list(product([-1.0, 1.0], repeat=n)))
    rng = np.random.default_rng(n)
    for _ in range(5):
        d = rng.choice([-1.0, 0.0, 0.0, 1.0, 3.0], n)
        assert p_of_mean(d) == pytest.approx(np.mean(np.abs(signs @ d) >= abs(d.sum())))


def test_rounding_errors_are_no_differences():
    was = np.array([1.0, 40.0, 0.0])
    np.testing.assert_array_equal(differences(was, was * (1.0 + 1e-12)), 0.0)
    assert differences(was, was + 1e-6).all()
    assert p_of_mean(np.zeros(4)) == 1.0
    assert p_of_mean(np.full(4, 0.02)) == 0.0


def test_holms_correction_rejects_more_than_bonferronis_within_its_level():
    assert holm(np.array([0.04, 0.012, 0.3, 0.016]), 0.05).tolist() == [False, True, False, True]
    assert holm(np.array([0.02, 0.02]), 0.05).tolist() == [True, True]

    def rejects_a_true_hypothesis(rng):  # a third of the hypotheses is true, and the statistics are correlated
        z = 0.8 * rng.standard_normal() + 0.6 * rng.standard_normal(30)
        z[:20] += 5.0
        return holm(2.0 * stats.norm.sf(np.abs(z)), 0.05)[20:].any()

    assert rejection_rate(rejects_a_true_hypothesis, 2000) <= 0.05 + 3.0 * np.sqrt(0.05 * 0.95 / 2000)


@pytest.mark.parametrize("n", [6, 16])
def test_the_smallest_change_is_detected_with_the_reported_power(n):
    """The power of Student's test by the noncentral t distribution, where the true deviation is that of the sample."""
    d = np.tile([-1.0, 1.0], n // 2)
    _, smallest = paired_interval(d, 0.01)
    critical, noncentrality = stats.t.ppf(0.995, n - 1), smallest / stats.sem(d)
    power = stats.nct.sf(critical, n - 1, noncentrality) + stats.nct.cdf(-critical, n - 1, noncentrality)
    assert 0.90 < power < 0.99


@pytest.mark.slow
def test_the_level_of_the_energy_test_is_exact_for_correlated_frames():
    def rejects(rng):
        runs = [
            rng.normal(2.0 * rng.standard_normal(), 1.0, (2, 12)) + 0.5 * rng.standard_normal((2, 1)) for _ in range(5)
        ]
        return energy_test([run[0] for run in runs], [run[1] for run in runs], rng)[1] <= 2.0 / 2**5

    assert rejection_rate(rejects, 400) == pytest.approx(2.0 / 2**5, abs=3.0 * np.sqrt(0.0625 * 0.9375 / 400))


def test_the_energy_test_detects_a_larger_spread_of_equal_mean():
    rng = np.random.default_rng(1)
    before = [rng.normal(30.0, 1.0, 60) for _ in range(8)]
    after = [rng.normal(30.0, 3.0, 60) for _ in range(8)]
    assert energy_test(before, after, rng)[1] == 2.0 / 2**8
    many = [rng.normal(30.0, scale, 20) for scale in (1.0, 3.0) for _ in range(12)]
    assert energy_test(many[:12], many[12:], rng)[1] < 0.01


@pytest.fixture(scope="module")
def record(tmp_path_factory):
    folder = tmp_path_factory.mktemp("paired")
    run = without_images(steps(6, n_particles=20))

    def record_run(name, error):
        result = {"mpjpe_abs_mm": error, "n_frames": 6.0}
        path = folder / f"{name}.rrd"
        return read(recorded.record(path, run, lambda step: {**errors(step), "mpjpe_abs_mm": error}, result))

    return record_run


def test_equal_runs_pass_and_changed_ones_fail_with_the_size_of_the_change(record):
    was = [record(f"was{k}", 40.0 + 10.0 * k) for k in range(4)]
    (same,) = compare_paired([(was, was)])
    assert {finding.quantity for finding in same} == {"mpjpe_abs_mm", "n_frames", "mpjpe_abs_mm in frames"}
    assert all(finding.passed for finding in same)
    now = [record(f"now{k}", 40.0 + 10.0 * k + 1.0 + 0.01 * k) for k in range(4)]
    findings = {finding.quantity: finding for finding in compare_paired([(was, now)])[0]}
    assert not findings["mpjpe_abs_mm"].passed  # by 1 mm, a tenth of the differences between seeds
    assert "by +1.02 ±" in findings["mpjpe_abs_mm"].detail
    assert findings["n_frames"].passed
    assert "4 pairs cannot show a change" in findings["mpjpe_abs_mm in frames"].detail


def test_a_number_that_is_not_finite_fails(record):
    was, now = [record(f"a{k}", 40.0 + k) for k in range(2)], [record("b0", float("nan")), record("b1", 41.0)]
    findings = {finding.quantity: finding for finding in compare_paired([(was, now)])[0]}
    assert findings["mpjpe_abs_mm"].detail == "not a finite number in every run"
