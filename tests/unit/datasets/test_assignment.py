"""The assignments by rising cost, against all there are."""

from itertools import islice, permutations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from workbench.datasets.association.assignment import best_assignments


@given(st.integers(0, 3), st.integers(0, 2), st.integers(0, 2**32 - 1), st.floats(0.0, 0.5))
def test_all_assignments_come_by_rising_cost(n, more, seed, forbidden):
    rng = np.random.default_rng(seed)
    costs = rng.normal(size=(n, n + more))
    costs[rng.random(costs.shape) < forbidden] = np.inf
    found = list(best_assignments(costs))
    every = {columns: costs[range(n), columns].sum() for columns in permutations(range(n + more), n)}
    allowed = {columns: cost for columns, cost in every.items() if np.isfinite(cost)}
    assert sorted(allowed) == sorted(tuple(columns.tolist()) for _, columns in found)
    costs_found = [cost for cost, _ in found]
    assert costs_found == sorted(costs_found)
    for cost, columns in found:
        assert cost == pytest.approx(allowed[tuple(columns.tolist())])


def test_the_first_ones_do_not_take_all():
    costs = np.random.default_rng(0).normal(size=(8, 16))
    first = list(islice(best_assignments(costs), 5))
    assert len({tuple(columns.tolist()) for _, columns in first}) == 5
