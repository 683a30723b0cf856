"""How unsure to be of the next person, against draws of people."""

import numpy as np
import pytest
from scipy.stats import t

from workbench.core.discrepancy import small_sample_inflation


def test_the_next_person_is_as_far_off_as_students_distribution_says():
    rng = np.random.default_rng(1)
    people, next_one = rng.standard_normal((200_000, 7)), rng.standard_normal(200_000)
    off = next_one / np.sqrt((people**2).mean(axis=1))  # in deviations learned from the seven
    assert off.std() == pytest.approx(small_sample_inflation(7), rel=0.02)
    assert small_sample_inflation(7) == pytest.approx(t(7).std())


def test_of_many_people_nothing_is_left_to_add():
    assert small_sample_inflation(1000) == pytest.approx(1.0, abs=2e-3)
    assert (
        small_sample_inflation(1)
        == small_sample_inflation(2)
        == small_sample_inflation(3)
        == pytest.approx(np.sqrt(3.0))
    )
