"""Systematic resampling with a fixed offset."""

import numpy as np
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from workbench.core.resampling import systematic_indices

positive = st.floats(1e-3, 1.0)


@given(arrays(float, st.integers(1, 60), elements=positive), st.integers(1, 80))
def test_numbers_of_copies_are_within_one_of_n_times_the_weight(weights, n):
    weights = weights / weights.sum()
    indices = systematic_indices(weights, 0.5, n)
    assert indices.shape == (n,)
    copies = np.bincount(indices, minlength=len(weights))
    assert (np.abs(copies - n * weights) < 1.0 + 1e-9).all()  # the definition of systematic resampling


def test_a_weight_of_zero_is_never_drawn():
    weights = np.array([0.0, 0.5, 0.0, 0.5, 0.0])
    assert set(systematic_indices(weights, 0.5, 1000)) == {1, 3}
