"""The implicit prior as a density: a mixture over the windows of paper C's database that its exact search finds."""

import math
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numba
import numpy as np

from workbench.body.simd_kinematics import inlined
from workbench.priors import implicit_search
from workbench.priors.density import SAME
from workbench.priors.implicit_prediction import N_POSE, WindowPrediction
from workbench.priors.implicit_search import PROBES, KdTree, found_entries, group_equal, padded
from workbench.utils.arrays import FloatArray, IntArray
from workbench.utils.errors import InputError
from workbench.utils.kernel_cache import kernel

BLOCK = 1 << 14  # windows whose ways are computed at a time


@dataclass(frozen=True, eq=False)
class WindowWays:
    """What each of n windows accounts for of a way between poses, see `WindowPrediction.way`, and how far noise takes
    it on.

    white: (n, K), the columns with noise first, over their deviations; the others, m or rad, last. order: (K,) which
    columns of a way those are. deviations: (K',) of those with noise.
    """

    white: FloatArray
    order: IntArray
    deviations: FloatArray

    @staticmethod
    def of(prediction: WindowPrediction) -> "WindowWays":
        """The ways of all windows of the prediction's database."""
        deviations = prediction.deviations[prediction.moved]
        order = np.argsort(deviations == 0.0, kind="stable")
        noisy = deviations[order][: np.count_nonzero(deviations)]
        n = len(prediction.windows)
        ways = WindowWays(np.empty((n, len(order))), order, noisy)
        for first in range(0, n, BLOCK):
            entries = np.arange(first, min(first + BLOCK, n))
            ways.white[entries] = ways.whitened(prediction.ways(entries))
        return ways

    def whitened(self, ways: FloatArray) -> FloatArray:
        """Ways (N, K) in the order and units of `white`."""
        white = ways[:, self.order]
        white[:, : len(self.deviations)] /= self.deviations
        return white


@dataclass(frozen=True, eq=False)
class ImplicitDensity:
    """p(pose_t | s_t−1) = Σ_i p(i | c_t−1) N(pose_t; m_i(s_t−1), Σ), m_i being where window i leads without noise.

    The windows i are those that the exact search finds, with the probabilities that it draws them with: this is the
    density of `Implicit.sample_transition`'s draws; all other windows have the part `tail_probability` of the mass of eq. 6 at
    most. Free are the pose's columns, of which those that are not modelled have no noise. `sample_dependent` draws the
    window from p(i | pose_t, c_t−1) and slides the memory on by the noise it implies. States must be one library frame
    apart."""

    prediction: WindowPrediction
    tree: KdTree
    beta: float
    tail_probability: float

    @property
    def free(self) -> IntArray:
        """The pose's columns (P,)."""
        return np.arange(N_POSE)

    def mean(self, state: FloatArray, dt_s: float) -> FloatArray:
        """Predict where the likeliest window, the nearest, leads states (N, D) without noise, (N, D)."""
        self._one_row(dt_s)
        probes, size = self._probes(state), len(state)
        order, firsts = group_equal(probes)
        entries = np.empty(size, dtype=np.int64)
        nearest = implicit_search.nearest_entries(self.tree, probes[order[firsts]], self.beta, self.tail_probability)
        entries[order] = np.repeat(nearest, np.diff(np.append(firsts, size)))
        return self.prediction.predict(state, entries, np.zeros((size, N_POSE)))

    def log_transition(self, previous: FloatArray, state: FloatArray, dt_s: float) -> FloatArray:
        """log p(pose | previous), (...), of states (..., D) that broadcast; one search for each distinct previous one.

        −∞ where a number of the pose that is not modelled is another than before.
        """
        self._one_row(dt_s)
        shape = np.broadcast_shapes(previous.shape[:-1], state.shape[:-1])
        known = N_POSE + self.tree.n_components  # the pose and the coefficients say it all
        before = np.broadcast_to(previous[..., :known], (*shape, known)).reshape(-1, known)
        after = np.broadcast_to(state[..., :N_POSE], (*shape, N_POSE)).reshape(-1, N_POSE)
        density, _ = self._log_mixture(before, after)
        held = ~np.isin(np.arange(N_POSE), self.prediction.moved)  # the columns that are not modelled
        same = (np.abs(after - before[:, :N_POSE])[:, held] <= SAME).all(axis=1)
        return np.where(same, density, -np.inf).reshape(shape)

    def sample_dependent(
        self, previous: FloatArray, state: FloatArray, dt_s: float, rng: np.random.Generator
    ) -> FloatArray:
        """States (N, D) with their poses, and memories drawn given those. A pose that no window leads to gets one of
        those that the search finds."""
        self._one_row(dt_s)
        _, entries = self._log_mixture(previous, state, rng.random(len(state)))
        return self.prediction.arrive(previous, state[:, :N_POSE], entries)

    @cached_property
    def _ways(self) -> WindowWays:
        return WindowWays.of(self.prediction)

    def _probes(self, state: FloatArray) -> FloatArray:
        return state[:, N_POSE : N_POSE + self.tree.n_components]

    def _log_mixture(
        self, before: FloatArray, after: FloatArray, uniforms: FloatArray | None = None
    ) -> tuple[FloatArray, IntArray]:
        white = self._ways.whitened(self.prediction.way(before[:, :N_POSE], after[:, :N_POSE]))
        return log_mixture(
            self.tree, self._probes(before), self.beta, self.tail_probability, self._ways, white, uniforms
        )

    def _one_row(self, dt_s: float) -> None:
        rate_hz = self.prediction.windows.rate_hz
        if abs(dt_s * rate_hz - 1.0) > 0.05:
            raise InputError(
                f"prior: frames {dt_s:.4g} s apart are {dt_s * rate_hz:.3g} rows of an implicit prior learned at "
                f"{rate_hz:g} Hz, whose density is of one; learn it at the video's rate, or choose an inference "
                "that only draws"
            )


def log_mixture(
    tree: KdTree, probes: FloatArray, beta: float, tail_probability: float, ways: WindowWays, white: FloatArray,
    uniforms: FloatArray | None = None,
) -> tuple[FloatArray, IntArray]:  # fmt: skip
    """log Σ_i p(i | c) N(way; way_i, Σ), (N,), and an entry (N,) drawn from its terms, for probes c (N, b).

    white: ways (N, K) as in `WindowWays.white`. uniforms: (N,) in [0, 1); None: nothing is drawn. One search for each
    distinct probe. Probes are shared out to numba's threads, on whose number nothing depends.
    """
    implicit_search.check_probes(tree, probes, beta, tail_probability)
    order, firsts = group_equal(probes)
    ends = np.append(firsts[1:], len(probes)) if len(probes) else firsts
    drawn = np.empty(0) if uniforms is None else uniforms[order]
    density, entries = np.empty(len(probes)), np.zeros(len(probes), dtype=np.int64)
    _log_mixture(
        tree.coefficients, tree.order, tree.leaf_boxes, tree.group_boxes, padded(probes[order[firsts]]), ends, beta,
        tail_probability, ways.white, len(ways.deviations), white[order], drawn, density, entries,
    )  # fmt: skip
    result, chosen = np.empty_like(density), np.empty_like(entries)
    result[order] = density - float(np.log(np.sqrt(2.0 * np.pi) * ways.deviations).sum())
    chosen[order] = entries
    return result, chosen


@kernel(parallel=True, error_model="numpy")
def _log_mixture(
    coefficients: Any, order: Any, leaf_boxes: Any, group_boxes: Any, probes: Any, ends: Any, beta: float,
    tail_probability: float, ways: Any, n_noisy: int, white: Any, uniforms: Any, density: Any, entries: Any,
) -> None:  # fmt: skip
    n, n_probes = order.shape[0], probes.shape[0]
    for chunk in numba.prange((n_probes + PROBES - 1) // PROBES):
        log_prob, found, terms = np.empty(n), np.empty(n, dtype=np.int64), np.empty(n)
        for k in range(chunk * PROBES, min((chunk + 1) * PROBES, n_probes)):
            n_found = found_entries(
                coefficients, order, leaf_boxes, group_boxes, probes[k], beta, tail_probability, log_prob, found
            )
            near = _gathered(ways, found[:n_found])
            for i in range(ends[k - 1] if k > 0 else 0, ends[k]):
                _fill_terms(near, n_noisy, white[i], log_prob, terms)
                largest = terms[:n_found].max()
                density[i] = largest
                if largest == -np.inf:  # no window leads there
                    terms[:n_found] = log_prob[:n_found]
                    largest = terms[:n_found].max()
                total = _add_up(terms[:n_found], largest)
                density[i] += math.log(total)
                if uniforms.shape[0] > 0:
                    place = np.searchsorted(terms[:n_found], uniforms[i] * total, side="right")
                    entries[i] = found[min(place, n_found - 1)]


@kernel(error_model="numpy")
def _gathered(ways: Any, found: Any) -> Any:
    """The ways of the entries found, (K, F), side by side for the vectors."""
    near = np.empty((ways.shape[1], found.shape[0]))
    for j in range(found.shape[0]):
        for column in range(ways.shape[1]):
            near[column, j] = ways[found[j], column]
    return near


@inlined
def _fill_terms(near: Any, n_noisy: int, white: Any, log_prob: Any, terms: Any) -> None:
    """The log terms of the mixture without their constant."""
    n_found = near.shape[1]
    for j in range(n_found):
        terms[j] = log_prob[j]
    for column in range(n_noisy):
        middle = white[column]
        for j in range(n_found):
            apart = near[column, j] - middle
            terms[j] -= 0.5 * apart * apart
    for column in range(n_noisy, near.shape[0]):
        for j in range(n_found):
            if abs(near[column, j] - white[column]) > SAME:
                terms[j] = -np.inf


@kernel(error_model="numpy")
def _add_up(terms: Any, largest: float) -> float:
    """Replace log terms by the running sums of their exponentials, over that of the largest; return the last."""
    total = 0.0
    for j in range(terms.shape[0]):
        total += math.exp(terms[j] - largest)
        terms[j] = total
    return total
