"""The likeliest ways to pair rows with columns, one after the other."""

import heapq
from collections.abc import Iterator
from itertools import count

import numpy as np
import scipy

from workbench.utils.arrays import FloatArray, IntArray


def best_assignments(costs: FloatArray) -> Iterator[tuple[float, IntArray]]:
    """Give the assignments of all n rows to some of m ≥ n columns by rising cost: their cost and the columns (n,).

    costs: (n, m), infinite where a pair is not allowed. The best of all assignments is found first; the others are
    split, by which is the first row that departs from it, into sets whose best is found likewise (Murty 1968).
    """
    order = count()  # ties are told apart by who came first
    heap: list[tuple[float, int, FloatArray, IntArray, int]] = []

    def push(allowed: FloatArray, fixed: int) -> None:
        try:
            columns = scipy.optimize.linear_sum_assignment(allowed)[1]
        except ValueError:  # nothing is allowed
            return
        cost = float(allowed[np.arange(len(columns)), columns].sum())
        heapq.heappush(heap, (cost, next(order), allowed, columns, fixed))

    push(np.asarray(costs, dtype=np.float64), 0)
    while heap:
        cost, _, allowed, columns, fixed = heapq.heappop(heap)
        yield cost, columns
        for row in range(fixed, len(columns)):
            without = allowed.copy()
            without[row, columns[row]] = np.inf
            for earlier in range(fixed, row):
                others = np.arange(allowed.shape[1]) != columns[earlier]
                without[earlier, others] = np.inf
            push(without, row)
