"""Bootstrap intervals against the exact bootstrap distribution and the normal limit; prediction intervals of means
against closed forms, Student's test and their coverage."""

from itertools import product

import numpy as np
import pytest
from scipy import stats

from workbench.evaluation.uncertainty.intervals import N_RESAMPLES, bootstrap_interval, mean_interval


def exact(values, level):
    """Return quantiles of the means of all nⁿ equally likely resamples."""
    means = np.sort([np.mean(resample) for resample in product(values, repeat=len(values))])
    return means[[int(np.ceil(q * len(means))) - 1 for q in ((1 - level) / 2, (1 + level) / 2)]]


@pytest.mark.parametrize("values", [[3.0, 1.0, 7.0], [0.0, 1.0, 10.0, 4.0], [5.0, 5.5, 5.1, 9.0, 2.0]])
@pytest.mark.parametrize("level", [0.95, 0.7])
def test_bootstrap_bounds_are_quantiles_of_all_resamples(values, level):
    """The level of a quantile of n resamples has a standard error of √(q (1 − q) / n), four of which are allowed."""
    interval = bootstrap_interval(np.array(values), np.random.default_rng(1), level)
    tail = (1 - level) / 2
    slack = 2 * 4 * np.sqrt(tail * (1 - tail) / N_RESAMPLES)
    widest, narrowest = exact(values, level + slack), exact(values, level - slack)
    assert widest[0] <= interval[0] <= narrowest[0]
    assert narrowest[1] <= interval[1] <= widest[1]


def test_the_interval_of_three_values_is_their_range():
    # 1 resample in 27 repeats the smallest value three times, which is more than the 2.5 % below the interval
    assert bootstrap_interval(np.array([4.0, 1.0, 2.5]), np.random.default_rng(0)).tolist() == [1.0, 4.0]


def test_columns_are_resampled_together():
    columns = np.random.default_rng(4).normal(size=(6, 3))
    intervals = bootstrap_interval(columns, np.random.default_rng(5))
    assert intervals.shape == (2, 3)
    for k in range(3):
        assert bootstrap_interval(columns[:, k], np.random.default_rng(5)).tolist() == intervals[:, k].tolist()


def test_one_value_has_no_interval_and_equal_values_have_width_zero():
    assert np.isnan(bootstrap_interval(np.array([3.0]), np.random.default_rng(0))).all()
    assert np.isnan(bootstrap_interval(np.empty((0, 2)), np.random.default_rng(0))).all()
    assert bootstrap_interval(np.full(5, 3.0), np.random.default_rng(0)).tolist() == [3.0, 3.0]


def test_one_old_value_has_the_prediction_interval_of_the_new_ones():
    new = np.array([3.0, 5.0, 4.0, 6.5, 4.5])
    expected = stats.t.ppf(0.975, 4) * new.std(ddof=1) * np.sqrt(1.0 + 1.0 / 5.0)
    # plus rounding, 1e-9 of the old value
    assert mean_interval(np.array([4.0]), new, 0.95) == pytest.approx(expected, rel=1e-8)


@pytest.mark.parametrize("shift", [0.0, 0.8, 2.0, 4.0])
def test_several_old_values_are_compared_as_by_students_two_sample_test(shift):
    rng = np.random.default_rng(3)
    old, new = rng.normal(0.0, 1.0, 6), rng.normal(shift, 1.0, 9)
    p = stats.ttest_ind(old, new, equal_var=True).pvalue
    for level in (0.5, 0.9, 0.99, 0.9999):
        assert (abs(new.mean() - old.mean()) <= mean_interval(old, new, level)) == (p >= 1.0 - level)


def test_values_that_are_equal_for_all_seeds_may_differ_by_rounding_only():
    assert 0.0 < mean_interval(np.array([40.0]), np.full(5, 40.0), 0.95) < 1e-6
