"""Systematic resampling (Carpenter, Clifford & Fearnhead 1999; Douc, Cappé & Moulines 2005)."""

from typing import Any

import numpy as np

from workbench.utils.arrays import FloatArray, IntArray
from workbench.utils.kernel_cache import kernel


def systematic_indices(weights: FloatArray, offset: float, n: int) -> IntArray:
    """Return ascending indices (n,) of the particles whose interval of the cumulative weight contains (offset + i) / n.

    Parameters
    ----------
    weights : (N,)
        Non-negative, with a positive sum.
    offset : in [0, 1)
        A uniform random number in a filter; 0.5 to select particles deterministically for display.
    """
    indices: IntArray = _search_cumulative(weights, offset, n)
    return indices


@kernel()
def _search_cumulative(weights: Any, offset: float, n: int) -> Any:
    """Locate the n ascending positions in one pass over the cumulative weights."""
    edges, indices = np.empty(weights.shape[0]), np.empty(n, dtype=np.int64)
    edge, last = 0.0, 0
    for j in range(weights.shape[0]):
        edge += weights[j]
        edges[j] = edge
        if weights[j] != 0.0:
            last = j  # rounding may leave the last edge short of one
    j = 0
    for i in range(n):
        position = (i + offset) / n * edge
        while j < last and edges[j] <= position:
            j += 1
        indices[i] = j
    return indices
