"""Paper C's binary tree over the coefficients of windows, and its probabilistic search (C, sections 4.1 and 4.2).

The tree is flat: the entries sorted by leaf, and for each of the 2^b leaf codes the number of entries before it. The
node of a level-l prefix p is then the range of codes [p 2^(b−l), (p + 1) 2^(b−l)); how many entries it holds is a
difference of two counts, and no pointer is followed. All coefficients are whitened, c_i,l / σ_l.
"""

import math
from dataclasses import dataclass
from typing import Any

import numba
import numpy as np
from scipy.special import logsumexp, ndtr

from workbench.arrays import Float32Array, FloatArray, IntArray
from workbench.errors import InputError

LEAVES = ("gaussian", "uniform")


@dataclass(frozen=True, eq=False)
class Tree:
    """n entries in 2^b leaves. A node's right child holds the entries at or above its split.

    coefficients: (n, b) float32, in the entries' own order. order: (n,) the entries sorted by leaf.
    starts: (2^b + 1,) where each leaf begins in `order`. splits: (2^b − 1,) in heap order: the children of node k are
    2k + 1 and 2k + 2; a node at level l splits component l.
    """

    coefficients: Float32Array
    order: IntArray
    starts: IntArray
    splits: Float32Array

    @property
    def depth(self) -> int:
        """b, the levels."""
        return int(self.coefficients.shape[1])


def sign_tree(coefficients: Float32Array) -> Tree:
    """The paper's tree: level l splits on the sign of component l. coefficients: (n, b), whitened, b ≤ 30."""
    coefficients = _checked(coefficients)
    b = coefficients.shape[1]
    codes = (coefficients >= 0.0) @ (1 << np.arange(b - 1, -1, -1, dtype=np.int64))
    starts = np.concatenate([[0], np.cumsum(np.bincount(codes, minlength=1 << b))])
    return Tree(coefficients, np.argsort(codes, kind="stable"), starts, np.zeros((1 << b) - 1, dtype=np.float32))


def median_tree(coefficients: Float32Array) -> Tree:
    """The balanced tree the paper mentions: a node of level l splits the median of component l among its entries."""
    coefficients = _checked(coefficients)
    n, b = coefficients.shape
    starts = np.arange((1 << b) + 1, dtype=np.int64) * n >> b
    splits = np.zeros((1 << b) - 1, dtype=np.float32)
    order = np.arange(n)
    _sort_by_halves(coefficients, starts, False, order, splits)
    return Tree(coefficients, order, starts, splits)


def balanced_order(coefficients: Float32Array, depth: int) -> tuple[IntArray, IntArray]:
    """The order (n,) and starts (2^depth + 1,) of a kd-tree: every node halved across its widest component."""
    starts = np.arange((1 << depth) + 1, dtype=np.int64) * len(coefficients) >> depth
    order = np.arange(len(coefficients))
    _sort_by_halves(coefficients, starts, True, order, np.zeros((1 << depth) - 1, dtype=np.float32))
    return order, starts


def draw(tree: Tree, probes: FloatArray, beta: float, uniforms: FloatArray, leaf: str = "gaussian") -> IntArray:
    """One entry (N,) for each probe (N, b) by probabilistic search (C, eq. 7 and 8).

    At level l the search goes right with probability Φ((c_t,l − split) / (√β σ_l)). A branch without entries is never
    taken: its sibling is, with probability one. In the leaf an entry is drawn by p(c_i | c_t) at the same temperature
    ("gaussian") or with equal odds ("uniform"). uniforms: (N, b + 1) in [0, 1), one per level and one for the leaf.
    """
    _check_search(tree, probes, beta, leaf)
    entries = np.empty(len(probes), dtype=np.int64)
    most = int(np.diff(tree.starts).max())
    _draw(
        tree.coefficients, tree.order, tree.starts, tree.splits, np.ascontiguousarray(probes), beta, uniforms,
        leaf == "gaussian", np.empty(most), entries,
    )  # fmt: skip
    return entries


def draw_reference(
    tree: Tree, probes: FloatArray, beta: float, uniforms: FloatArray, leaf: str = "gaussian"
) -> IntArray:
    """The same as `draw` in plain NumPy."""
    entries = np.empty(len(probes), dtype=np.int64)
    for i, (probe, uniform) in enumerate(zip(probes, uniforms, strict=True)):
        node, low, high = 0, 0, 1 << tree.depth
        for level in range(tree.depth):
            middle = (low + high) // 2
            left, right = tree.starts[middle] - tree.starts[low], tree.starts[high] - tree.starts[middle]
            odds = ndtr((probe[level] - tree.splits[node]) / np.sqrt(beta))
            goes_right = right > 0 and (left == 0 or uniform[level] < odds)
            node = 2 * node + 1 + goes_right
            low, high = (middle, high) if goes_right else (low, middle)
        inside = tree.order[tree.starts[low] : tree.starts[high]]
        odds = np.exp(_leaf_log_prob(tree, inside, probe, beta, leaf)).cumsum()
        entries[i] = inside[min(np.searchsorted(odds, uniform[-1] * odds[-1], side="right"), len(inside) - 1)]
    return entries


def log_proposal(tree: Tree, probe: FloatArray, beta: float, leaf: str = "gaussian") -> FloatArray:
    """log q(i | c_t), (n,), the log probability with which `draw` returns each entry for one probe (b,)."""
    _check_search(tree, probe[None], beta, leaf)
    whole = np.zeros(1)
    for level in range(tree.depth):
        bounds = tree.starts[:: 1 << (tree.depth - level - 1)]
        left, right = np.diff(bounds).reshape(-1, 2).T > 0
        offset = (probe[level] - tree.splits[(1 << level) - 1 : (2 << level) - 1]) / np.sqrt(beta)
        with np.errstate(divide="ignore"):
            odds = np.log(np.stack([ndtr(-offset), ndtr(offset)], axis=1))
        odds[left & ~right] = (0.0, -np.inf)
        odds[right & ~left] = (-np.inf, 0.0)
        whole = (whole[:, None] + odds).ravel()
    sizes = np.diff(tree.starts)
    full = sizes > 0
    inside = np.zeros(len(tree.order))
    if leaf == "gaussian":
        squares = ((tree.coefficients[tree.order].astype(np.float64) - probe) ** 2).sum(axis=1)
        inside = -squares / (2.0 * beta)
    within = inside - np.repeat(np.logaddexp.reduceat(inside, tree.starts[:-1][full]), sizes[full])
    log_prob = np.empty(len(tree.order))
    log_prob[tree.order] = np.repeat(whole[full], sizes[full]) + within
    return log_prob


def _leaf_log_prob(tree: Tree, inside: IntArray, probe: FloatArray, beta: float, leaf: str) -> FloatArray:
    if leaf == "uniform":
        return np.full(len(inside), -np.log(len(inside)))
    exponents = -((tree.coefficients[inside].astype(np.float64) - probe) ** 2).sum(axis=1) / (2.0 * beta)
    log_prob: FloatArray = exponents - logsumexp(exponents)
    return log_prob


def _checked(coefficients: Float32Array) -> Float32Array:
    if coefficients.ndim != 2 or len(coefficients) == 0 or not 1 <= coefficients.shape[1] <= 30:
        raise InputError(f"tree: expected coefficients (n, b) with 1 ≤ b ≤ 30, found {coefficients.shape}")
    return np.ascontiguousarray(coefficients, dtype=np.float32)


def _check_search(tree: Tree, probes: FloatArray, beta: float, leaf: str) -> None:
    if probes.shape[1:] != (tree.depth,):
        raise ValueError(f"probes must be (N, {tree.depth}), found {probes.shape}")
    if not beta > 0.0:
        raise InputError(f"prior: the temperature beta must be positive, found {beta}")
    if leaf not in LEAVES:
        raise InputError(f"prior: leaf must be one of {', '.join(LEAVES)}, found {leaf!r}")


@numba.njit(cache=True, nogil=True)
def _draw(
    coefficients: Any, order: Any, starts: Any, splits: Any, probes: Any, beta: float, uniforms: Any,
    gaussian: bool, weights: Any, entries: Any,
) -> None:  # fmt: skip
    n_levels = probes.shape[1]
    steepness = 1.0 / math.sqrt(2.0 * beta)
    for i in range(probes.shape[0]):
        node, low, high = 0, 0, 1 << n_levels
        for level in range(n_levels):
            middle = (low + high) // 2
            goes_right = starts[high] > starts[middle]
            if goes_right and starts[middle] > starts[low]:
                odds = 0.5 * math.erfc(steepness * (splits[node] - probes[i, level]))
                goes_right = uniforms[i, level] < odds
            node = 2 * node + (2 if goes_right else 1)
            if goes_right:
                low = middle
            else:
                high = middle
        first, last = starts[low], starts[high]
        uniform = uniforms[i, n_levels]
        if gaussian and last - first > 1:
            entries[i] = order[
                first + _gaussian_leaf(coefficients, order[first:last], probes[i], beta, uniform, weights)
            ]
        else:
            entries[i] = order[first + min(int(uniform * (last - first)), last - first - 1)]


@numba.njit(cache=True, nogil=True)
def _gaussian_leaf(coefficients: Any, inside: Any, probe: Any, beta: float, uniform: float, weights: Any) -> int:
    nearest = np.inf
    for j in range(inside.shape[0]):
        square = 0.0
        for k in range(probe.shape[0]):
            away = coefficients[inside[j], k] - probe[k]
            square += away * away
        weights[j] = square / (2.0 * beta)
        nearest = min(nearest, weights[j])
    total = 0.0
    for j in range(inside.shape[0]):
        total += math.exp(nearest - weights[j])
        weights[j] = total
    wanted = uniform * total
    for j in range(inside.shape[0] - 1):
        if wanted < weights[j]:
            return j
    return int(inside.shape[0]) - 1


@numba.njit(cache=True, nogil=True)
def _sort_by_halves(coefficients: Any, starts: Any, widest: bool, order: Any, splits: Any) -> None:
    """Level by level, sort every node's entries by one component, so that `starts` cuts it in halves."""
    n_leaves = starts.shape[0] - 1
    values = np.empty(order.shape[0], dtype=coefficients.dtype)
    width, level = n_leaves, 0
    while width > 1:
        for node in range(n_leaves // width):
            first, middle, last = starts[node * width], starts[node * width + width // 2], starts[(node + 1) * width]
            component = _widest(coefficients, order[first:last]) if widest else level
            for j in range(first, last):
                values[j] = coefficients[order[j], component]
            order[first:last] = order[first:last][np.argsort(values[first:last], kind="mergesort")]
            if first < middle < last:
                below, above = coefficients[order[middle - 1], component], coefficients[order[middle], component]
                splits[n_leaves // width - 1 + node] = 0.5 * (below + above)
        width, level = width // 2, level + 1


@numba.njit(cache=True, nogil=True)
def _widest(coefficients: Any, inside: Any) -> int:
    best, widest = 0, -1.0
    for k in range(coefficients.shape[1]):
        low, high = np.inf, -np.inf
        for j in range(inside.shape[0]):
            low, high = min(low, coefficients[inside[j], k]), max(high, coefficients[inside[j], k])
        if high - low > widest:
            best, widest = k, high - low
    return best
