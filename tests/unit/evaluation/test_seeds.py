"""The interval of `--seeds` against closed forms, scipy's test, and its own promise."""

import numpy as np
import pytest
from scipy import stats

from workbench.evaluation.intervals import mean_interval


def test_with_one_old_number_it_is_the_prediction_interval_of_the_new_ones():
    new = np.array([3.0, 5.0, 4.0, 6.5, 4.5])
    expected = stats.t.ppf(0.975, 4) * new.std(ddof=1) * np.sqrt(1.0 + 1.0 / 5.0)
    # beside it only the rounding of the old number, 1e-9 of it
    assert mean_interval(np.array([4.0]), new, 0.95) == pytest.approx(expected, rel=1e-8)


@pytest.mark.parametrize("shift", [0.0, 0.8, 2.0, 4.0])
def test_with_several_it_decides_as_student_s_two_sample_test(shift):
    rng = np.random.default_rng(3)
    old, new = rng.normal(0.0, 1.0, 6), rng.normal(shift, 1.0, 9)
    p = stats.ttest_ind(old, new, equal_var=True).pvalue
    for level in (0.5, 0.9, 0.99, 0.9999):
        assert (abs(new.mean() - old.mean()) <= mean_interval(old, new, level)) == (p >= 1.0 - level)


@pytest.mark.parametrize("n", [1, 4])
def test_equal_distributions_pass_as_often_as_the_level_says(n):
    rng = np.random.default_rng(11)
    trials, level = 4000, 0.95
    passed = 0
    for _ in range(trials):
        old, new = rng.normal(10.0, 2.0, n), rng.normal(10.0, 2.0, 5)
        passed += abs(new.mean() - old.mean()) <= mean_interval(old, new, level)
    # four standard deviations of a binomial share
    assert passed / trials == pytest.approx(level, abs=4.0 * np.sqrt(level * (1.0 - level) / trials))


def test_a_number_that_no_seed_moves_may_differ_by_rounding_only():
    same = np.full(5, 40.0)
    assert 0.0 < mean_interval(np.array([40.0]), same, 0.95) < 1e-6
