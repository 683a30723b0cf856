"""Histograms of a weighted particle set: marginals of its parameters over the frames."""

from typing import Any

import numpy as np

from workbench.utils.arrays import Float32Array, FloatArray
from workbench.utils.kernel_cache import kernel

LOWEST_LOG_MASS = float(np.log(1e-4))
"""What an empty bin of a marginal shows."""
MOST_PICTURED = 1024
"""Columns of a picture: of more frames each is the mean of two, four, eight …, which bounds the memory."""
_FINE = 4


class Marginals:
    """The marginals of K parameters over the frames so far, as histograms on one axis per parameter.

    An axis starts as the range of the first particle set. When later particles leave it, it doubles towards them and
    neighbouring bins are merged: past frames keep their mass, no sample need be stored, and a frame costs
    the same however long the run is. Four times finer bins than asked for make up for what doubling leaves empty.
    every: frames of a column.
    """

    def __init__(self, n_parameters: int, n_bins: int) -> None:
        self._n_bins, self._n_fine = n_bins, _FINE * n_bins
        self._low, self._width = np.zeros(n_parameters), np.zeros(n_parameters)
        self._mass: Float32Array = np.empty((MOST_PICTURED, n_parameters, self._n_fine), dtype=np.float32)
        self._n_columns: int = 0
        self.every, self._in_last = 1, 1

    def add(self, values: FloatArray, weights: FloatArray) -> None:
        """Add one more frame: values (N, K), finite, with weights (N,) that sum to one."""
        lowest, highest = values.min(axis=0), values.max(axis=0)
        if self._n_columns == 0:
            spread = np.maximum(highest - lowest, 1e-6 * np.maximum(np.abs(highest), 1.0))
            self._low, self._width = lowest - 0.01 * spread, 1.02 * spread
        for k in np.flatnonzero((lowest < self._low) | (highest >= self._low + self._width)):
            while lowest[k] < self._low[k] or highest[k] >= self._low[k] + self._width[k]:
                self._double(int(k), downwards=bool(lowest[k] < self._low[k]))
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

    def take_over(self, low: FloatArray, high: FloatArray, log_mass: FloatArray, n_frames: int) -> int:
        """Begin with frames of which only a `picture` is left; its bins' mass is spread evenly over the finer ones.

        n_frames: the number of frames, of which the picture shows all but less than a column. Returns how many are
        taken over, those of whole columns.
        """
        while self.every * (log_mass.shape[2] + 1) <= n_frames:
            self.every *= 2
        self._n_columns = n_frames // self.every
        mass = np.where(log_mass > LOWEST_LOG_MASS + 1e-3, np.exp(log_mass) / _FINE, 0.0).astype(np.float32)
        self._low, self._width = low.copy(), high - low
        self._mass[: self._n_columns] = np.repeat(np.moveaxis(mass, 2, 0)[: self._n_columns], _FINE, axis=2)
        self._in_last = self.every
        return self._n_columns * self.every

    def picture(self) -> tuple[FloatArray, FloatArray, Float32Array]:
        """Return the axes' low and high ends (K,), and each bin's log mass (K, B, frames), from LOWEST_LOG_MASS up.

        An axis reaches over the bins that can be seen in some frame; fainter ones outside are cut off.
        """
        n_parameters, n_frames = len(self._low), self._n_columns
        log_mass = np.empty((n_parameters, self._n_bins, n_frames), dtype=np.float32)
        starts, merged = np.empty((2, n_parameters), dtype=np.int64)
        for k in range(n_parameters):  # one by one, which takes little memory
            fine = np.ascontiguousarray(self._mass[:n_frames, k].T)
            seen = np.flatnonzero((fine > np.exp(LOWEST_LOG_MASS)).any(axis=1))
            merged[k] = -(-(seen[-1] + 1 - seen[0]) // self._n_bins)
            window = self._n_bins * merged[k]
            starts[k] = min(max((seen[0] + seen[-1] + 1 - window) // 2, 0), self._n_fine - window)
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
    """Sum the weights of the values (N,) in each bin between equidistant edges (B + 1,).

    Values outside count in the outermost bins. Faster than NumPy's, which sorts.
    """
    n_bins = len(edges) - 1
    return masses(values[:, None], weights, edges[:1], n_bins / (edges[-1:] - edges[0]), n_bins)[0]


def masses(values: FloatArray, weights: FloatArray, low: FloatArray, per_unit: FloatArray, n_bins: int) -> FloatArray:
    """Sum the weights (N,) of the values (N, K), finite, in the bins of each column, (K, n_bins), in the order of the
    rows. low: (K,), where a column's bins begin. per_unit: (K,), bins per unit. Values outside count in the outermost
    bins."""
    found = np.zeros((values.shape[1], n_bins))
    _add_masses(np.ascontiguousarray(values.T), weights, low, per_unit, found)
    return found


@kernel(error_model="numpy")
def _add_masses(columns: Any, weights: Any, low: Any, per_unit: Any, found: Any) -> None:
    last = found.shape[1] - 1
    for k in range(columns.shape[0]):
        for i in range(columns.shape[1]):
            found[k, min(max(int((columns[k, i] - low[k]) * per_unit[k]), 0), last)] += weights[i]
