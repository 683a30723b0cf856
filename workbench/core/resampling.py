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
    indices = np.empty(n, dtype=np.int64)
    _search_cumulative(weights, offset, np.empty(len(weights)), indices)
    return indices


@kernel()
def _search_cumulative(weights: Any, offset: float, edges: Any, indices: Any) -> None:
    """Locate the n ascending positions in one pass over the cumulative weights, which `edges` receives."""
    n, edge, last = indices.shape[0], 0.0, 0
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
