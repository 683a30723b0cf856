"""Inflation of a standard deviation that is estimated from few people, against simulated people."""

import numpy as np
import pytest
from scipy.stats import t

from workbench.core.discrepancy import small_sample_inflation


def test_inflation_is_the_standard_deviation_of_students_distribution():
    rng = np.random.default_rng(1)
    people, next_person = rng.standard_normal((200_000, 7)), rng.standard_normal(200_000)
    standardized = next_person / np.sqrt((people**2).mean(axis=1))  # by the standard deviation of the seven
    assert standardized.std() == pytest.approx(small_sample_inflation(7), rel=0.02)
    assert small_sample_inflation(7) == pytest.approx(t(7).std())


def test_inflation_tends_to_one_and_is_bounded_for_up_to_three_people():
    assert small_sample_inflation(1000) == pytest.approx(1.0, abs=2e-3)
    assert [small_sample_inflation(n) for n in (1, 2, 3)] == pytest.approx([np.sqrt(3.0)] * 3)
