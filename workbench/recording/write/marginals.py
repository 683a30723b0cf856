"""Histograms of a weighted particle set: marginals of its parameters over the frames."""

from typing import Any

import numpy as np

from workbench.utils.arrays import Float32Array, FloatArray
from workbench.utils.kernel_cache import kernel

LOWEST_LOG_MASS = float(np.log(1e-4))
"""Log mass of an empty bin of a marginal."""
MAX_COLUMNS = 1024
"""Columns of a picture; of more frames each column is the mean of two, four, eight …, which bounds the memory."""
_FINE = 4


class Marginals:
    """The marginals of K parameters over the frames so far, as histograms on one axis per parameter.

    An axis starts as the range of the first particle set. When later particles leave it, it doubles towards them and
    neighbouring bins are merged: past frames retain their mass, no samples are stored, and the cost of a frame does not
    depend on the length of the run. Four times finer bins than requested compensate for bins that doubling leaves
    empty. every: frames of a column.
    """

    def __init__(self, n_parameters: int, n_bins: int) -> None:
        self._n_bins, self._n_fine = n_bins, _FINE * n_bins
        self._low, self._width = np.zeros(n_parameters), np.zeros(n_parameters)
        self._mass: Float32Array = np.empty((MAX_COLUMNS, n_parameters, self._n_fine), dtype=np.float32)
        self._n_columns: int = 0
        self.every, self._in_last = 1, 1

    def add(self, values: FloatArray, weights: FloatArray) -> None:
        """Add a frame: values (N, K), finite, with normalised weights (N,)."""
        lower, upper = values.min(axis=0), values.max(axis=0)
        if self._n_columns == 0:
            spread = np.maximum(upper - lower, 1e-6 * np.maximum(np.abs(upper), 1.0))
            self._low, self._width = lower - 0.01 * spread, 1.02 * spread
        for k in np.flatnonzero((lower < self._low) | (upper >= self._low + self._width)):
            while lower[k] < self._low[k] or upper[k] >= self._low[k] + self._width[k]:
                self._double(int(k), downwards=bool(lower[k] < self._low[k]))
        mass = masses(values, weights, self._low, self._n_fine / self._width, self._n_fine).astype(np.float32)
        if self._in_last < self.every:
            self._in_last += 1
            last = self._mass[self._n_columns - 1]
            last += (mass - last) / np.float32(self._in_last)
            return
        if self._n_columns == len(self._mass):
            self._n_columns //= 2
            for i in range(self._n_columns):  # one by one, which takes little memory
                self._mass[i] = (self._mass[2 * i] + self._mass[2 * i + 1]) * np.float32(0.5)
            self.every *= 2
        self._mass[self._n_columns] = mass
        self._n_columns, self._in_last = self._n_columns + 1, 1

    def picture(self) -> tuple[FloatArray, FloatArray, Float32Array]:
        """Return the axes' low and high ends (K,), and each bin's log mass (K, B, frames), from LOWEST_LOG_MASS up.

        An axis covers the bins above LOWEST_LOG_MASS in any frame.
        """
        n_parameters, n_frames = len(self._low), self._n_columns
        log_mass = np.empty((n_parameters, self._n_bins, n_frames), dtype=np.float32)
        starts, merged = np.empty((2, n_parameters), dtype=np.int64)
        for k in range(n_parameters):  # one by one, which takes little memory
            fine = np.ascontiguousarray(self._mass[:n_frames, k].T)
            visible = np.flatnonzero((fine > np.exp(LOWEST_LOG_MASS)).any(axis=1))
            merged[k] = -(-(visible[-1] + 1 - visible[0]) // self._n_bins)
            window = self._n_bins * merged[k]
            starts[k] = min(max((visible[0] + visible[-1] + 1 - window) // 2, 0), self._n_fine - window)
            cut = fine[starts[k] : starts[k] + window]
            mass = cut.reshape(self._n_bins, merged[k], n_frames).sum(axis=1).astype(np.float64)
            log_mass[k] = np.log(np.maximum(mass, np.exp(LOWEST_LOG_MASS)))
        step = self._width / self._n_fine
        low = self._low + starts * step
        return low, low + self._n_bins * merged * step, log_mass

    def _double(self, k: int, downwards: bool) -> None:
        half = self._n_fine // 2
        mass = self._mass[: self._n_columns, k]
        merged = mass.reshape(-1, half, 2).sum(axis=2)
        mass[:] = 0.0
        mass[:, slice(half, None) if downwards else slice(half)] = merged
        self._low[k] -= self._width[k] if downwards else 0.0
        self._width[k] *= 2.0


def histogram(values: FloatArray, weights: FloatArray, edges: FloatArray) -> FloatArray:
    """Return the weights' sums (B,) of values (N,) in the bins between equidistant edges (B + 1,).

    Values outside count in the outermost bins. It is faster than NumPy's histogram, which sorts.
    """
    n_bins = len(edges) - 1
    return masses(values[:, None], weights, edges[:1], n_bins / (edges[-1:] - edges[0]), n_bins)[0]


def masses(values: FloatArray, weights: FloatArray, low: FloatArray, per_unit: FloatArray, n_bins: int) -> FloatArray:
    """Return the weights' sums (K, n_bins) of values (N, K), finite, in the bins of each column, summed in row order.

    Values outside count in the outermost bins.

    Parameters
    ----------
    values, weights : (N, K) and (N,).
    low : (K,), lower end of a column's bins.
    per_unit : (K,), bins per unit.
    n_bins : per column.
    """
    sums = np.zeros((values.shape[1], n_bins))
    _add_masses(np.ascontiguousarray(values.T), weights, low, per_unit, sums)
    return sums


@kernel(error_model="numpy")
def _add_masses(columns: Any, weights: Any, low: Any, per_unit: Any, sums: Any) -> None:
    last = sums.shape[1] - 1
    for k in range(columns.shape[0]):
        for i in range(columns.shape[1]):
            sums[k, min(max(int((columns[k, i] - low[k]) * per_unit[k]), 0), last)] += weights[i]
