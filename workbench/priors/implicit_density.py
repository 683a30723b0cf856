"""Transition density of the implicit prior: a mixture over the windows of paper C's database in its exact search."""

import math
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from workbench.body.simd_kinematics import inlined
from workbench.priors import implicit_search
from workbench.priors.density import SAME
from workbench.priors.implicit_prediction import N_POSE, WindowPrediction
from workbench.priors.implicit_search import PROBES, KdTree, group_equal, padded, search_entries
from workbench.utils.arrays import FloatArray, IntArray
from workbench.utils.errors import InputError
from workbench.utils.kernel_cache import kernel
from workbench.utils.parallel import parallel_for

BLOCK = 1 << 14  # windows whose displacements are computed at a time


@dataclass(frozen=True, eq=False)
class WindowDisplacements:
    """Predicted displacements of n windows, see `WindowPrediction.displacement`, whitened by the noise.

    whitened : (n, K); columns with noise first, over their standard deviations; the others, m or rad, last. order :
    (K,) their columns in a displacement. std : (K',) of the columns with noise.
    """

    whitened: FloatArray
    order: IntArray
    std: FloatArray

    @staticmethod
    def of(prediction: WindowPrediction) -> "WindowDisplacements":
        """Return the displacements of all windows of the prediction's database."""
        std = prediction.std[prediction.modelled]
        order = np.argsort(std == 0.0, kind="stable")
        noisy = std[order][: np.count_nonzero(std)]
        n = len(prediction.windows)
        displacements = WindowDisplacements(np.empty((n, len(order))), order, noisy)
        for first in range(0, n, BLOCK):
            entries = np.arange(first, min(first + BLOCK, n))
            predicted = prediction.predicted_displacements(entries)
            displacements.whitened[entries] = displacements.whiten(predicted)
        return displacements

    def whiten(self, displacements: FloatArray) -> FloatArray:
        """Return displacements (N, K) in the order and units of `whitened`."""
        whitened = displacements[:, self.order]
        whitened[:, : len(self.std)] /= self.std
        return whitened


@dataclass(frozen=True, eq=False)
class ImplicitDensity:
    """p(pose_t | s_t−1) = Σ_i p(i | c_t−1) N(pose_t; m_i(s_t−1), Σ), m_i being the noise-free prediction of window i.

    The windows i are those that the exact search returns, with its probabilities: this is the density of
    `Implicit.sample_transition`. All other windows together have at most `tail_probability` of the mass of eq. 6. The
    pose's columns are free; those that are not modelled have no noise. `sample_dependent` samples the window from
    p(i | pose_t, c_t−1) and updates the memory with the implied noise. States are one library frame apart.
    """

    prediction: WindowPrediction
    tree: KdTree
    beta: float
    tail_probability: float

    @property
    def free(self) -> IntArray:
        """The pose's columns (P,)."""
        return np.arange(N_POSE)

    def mean(self, state: FloatArray, dt_s: float) -> FloatArray:
        """Return the noise-free prediction (N, D) of states (N, D) by the most probable window, the nearest."""
        self._one_row(dt_s)
        probes, size = self._probes(state), len(state)
        order, firsts = group_equal(probes)
        entries = np.empty(size, dtype=np.int64)
        nearest = implicit_search.nearest_entries(self.tree, probes[order[firsts]], self.beta, self.tail_probability)
        entries[order] = np.repeat(nearest, np.diff(np.append(firsts, size)))
        return self.prediction.predict(state, entries, np.zeros((size, N_POSE)))

    def log_transition(self, previous: FloatArray, state: FloatArray, dt_s: float) -> FloatArray:
        """Return log p(pose | previous), (...), of states (..., D) that broadcast.

        There is one search per distinct previous state. It is −∞ if a pose parameter that is not modelled changes.
        """
        self._one_row(dt_s)
        shape = np.broadcast_shapes(previous.shape[:-1], state.shape[:-1])
        size = N_POSE + self.tree.n_components  # the density depends on the pose and the coefficients only
        before = np.broadcast_to(previous[..., :size], (*shape, size)).reshape(-1, size)
        after = np.broadcast_to(state[..., :N_POSE], (*shape, N_POSE)).reshape(-1, N_POSE)
        density, _ = self._log_mixture(before, after)
        fixed = ~np.isin(np.arange(N_POSE), self.prediction.modelled)
        same = (np.abs(after - before[:, :N_POSE])[:, fixed] <= SAME).all(axis=1)
        return np.where(same, density, -np.inf).reshape(shape)

    def sample_dependent(
        self, previous: FloatArray, state: FloatArray, dt_s: float, rng: np.random.Generator
    ) -> FloatArray:
        """Return states (N, D) with memories sampled given their poses.

        A pose that no window can produce gets one of the windows in the search.
        """
        self._one_row(dt_s)
        _, entries = self._log_mixture(previous, state, rng.random(len(state)))
        return self.prediction.with_pose(previous, state[:, :N_POSE], entries)

    @cached_property
    def _displacements(self) -> WindowDisplacements:
        return WindowDisplacements.of(self.prediction)

    def _probes(self, state: FloatArray) -> FloatArray:
        return state[:, N_POSE : N_POSE + self.tree.n_components]

    def _log_mixture(
        self, before: FloatArray, after: FloatArray, uniforms: FloatArray | None = None
    ) -> tuple[FloatArray, IntArray]:
        observed = self._displacements.whiten(self.prediction.displacement(before[:, :N_POSE], after[:, :N_POSE]))
        search = self.tree, self._probes(before), self.beta, self.tail_probability
        return log_mixture(*search, self._displacements, observed, uniforms)

    def _one_row(self, dt_s: float) -> None:
        rate_hz = self.prediction.windows.rate_hz
        if abs(dt_s * rate_hz - 1.0) > 0.05:
            raise InputError(
                f"prior: a frame interval of {dt_s:.4g} s is {dt_s * rate_hz:.3g} rows of an implicit prior learned at "
                f"{rate_hz:g} Hz, whose density covers one; learn it at the video's rate, or choose an inference "
                "that needs no density"
            )


def log_mixture(
    tree: KdTree, probes: FloatArray, beta: float, tail_probability: float, displacements: WindowDisplacements,
    observed: FloatArray, uniforms: FloatArray | None = None,
) -> tuple[FloatArray, IntArray]:  # fmt: skip
    """Return log Σ_i p(i | c) N(x; x_i, Σ), (N,), of displacements x, and an entry (N,) sampled from its terms.

    There is one search per distinct probe. Probes are distributed over numba's threads; the result does not depend on
    their number.

    Parameters
    ----------
    tree, beta, tail_probability : as for `implicit_search.search`.
    probes : c, (N, b).
    displacements : x_i, of the windows.
    observed : x, (N, K), as in `WindowDisplacements.whitened`.
    uniforms : (N,) in [0, 1); None: no entries are sampled.
    """
    implicit_search.check_probes(tree, probes, beta, tail_probability)
    order, firsts = group_equal(probes)
    ends = np.append(firsts[1:], len(probes)) if len(probes) else firsts
    ordered_uniforms = np.empty(0) if uniforms is None else uniforms[order]
    density, entries = np.empty(len(probes)), np.zeros(len(probes), dtype=np.int64)
    arguments = (
        tree.coefficients, tree.order, tree.leaf_boxes, tree.group_boxes, padded(probes[order[firsts]]), ends, beta,
        tail_probability, displacements.whitened, len(displacements.std), observed[order], ordered_uniforms,
        density, entries,
    )  # fmt: skip
    parallel_for(lambda first, last: _log_mixture(first, last, *arguments), len(ends), PROBES)
    result, chosen = np.empty_like(density), np.empty_like(entries)
    result[order] = density - float(np.log(np.sqrt(2.0 * np.pi) * displacements.std).sum())
    chosen[order] = entries
    return result, chosen


@kernel(error_model="numpy")
def _log_mixture(
    first: int, last: int,
    coefficients: Any, order: Any, leaf_boxes: Any, group_boxes: Any, probes: Any, ends: Any, beta: float,
    tail_probability: float, displacements: Any, n_noisy: int, observed: Any, uniforms: Any, density: Any, entries: Any,
) -> None:  # fmt: skip
    n = order.shape[0]
    log_prob, candidates, terms = np.empty(n), np.empty(n, dtype=np.int64), np.empty(n)
    for k in range(first, last):
        n_candidates = search_entries(
            coefficients, order, leaf_boxes, group_boxes, probes[k], beta, tail_probability, log_prob, candidates
        )
        means = _gathered(displacements, candidates[:n_candidates])
        for i in range(ends[k - 1] if k > 0 else 0, ends[k]):
            _fill_terms(means, n_noisy, observed[i], log_prob, terms)
            largest = terms[:n_candidates].max()
            density[i] = largest
            if largest == -np.inf:  # no window predicts it
                terms[:n_candidates] = log_prob[:n_candidates]
                largest = terms[:n_candidates].max()
            total = _cumulate(terms[:n_candidates], largest)
            density[i] += math.log(total)
            if uniforms.shape[0] > 0:
                position = np.searchsorted(terms[:n_candidates], uniforms[i] * total, side="right")
                entries[i] = candidates[min(position, n_candidates - 1)]


@kernel(error_model="numpy")
def _gathered(displacements: Any, entries: Any) -> Any:
    """Return the displacements of F entries, (K, F), contiguous for vector instructions."""
    gathered = np.empty((displacements.shape[1], entries.shape[0]))
    for j in range(entries.shape[0]):
        for column in range(displacements.shape[1]):
            gathered[column, j] = displacements[entries[j], column]
    return gathered


@inlined
def _fill_terms(means: Any, n_noisy: int, observed: Any, log_prob: Any, terms: Any) -> None:
    """Fill `terms` with the log terms of the mixture without their constant."""
    n_candidates = means.shape[1]
    for j in range(n_candidates):
        terms[j] = log_prob[j]
    for column in range(n_noisy):
        value = observed[column]
        for j in range(n_candidates):
            difference = means[column, j] - value
            terms[j] -= 0.5 * difference * difference
    for column in range(n_noisy, means.shape[0]):
        for j in range(n_candidates):
            if abs(means[column, j] - observed[column]) > SAME:
                terms[j] = -np.inf


@kernel(error_model="numpy")
def _cumulate(terms: Any, largest: float) -> float:
    """Replace log terms by the cumulative sum of exp(term − largest); return the total."""
    total = 0.0
    for j in range(terms.shape[0]):
        total += math.exp(terms[j] - largest)
        terms[j] = total
    return total
