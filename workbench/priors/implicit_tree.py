"""Paper C's binary tree over the coefficients of windows, and its probabilistic search (C, sections 4.1 and 4.2).

The tree is flat: the entries sorted by leaf, and for each of the 2^b leaf codes the number of entries before it. The
node of a level-l prefix p is then the range of codes [p 2^(b−l), (p + 1) 2^(b−l)); how many entries it holds is a
difference of two counts, and no pointer is followed. All coefficients are whitened, c_i,l / σ_l. How faithfully a
search samples p(c_i | c_t) is measured by enumeration.
"""

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
import scipy

from workbench.body.simd_kinematics import inlined
from workbench.priors.implicit_search import KdTree, exact_log_prob, found_distribution
from workbench.utils.arrays import Float32Array, FloatArray, IntArray
from workbench.utils.errors import InputError
from workbench.utils.kernel_cache import kernel

LEAVES = ("gaussian", "uniform")
TABLE_END = 6.0
TABLE = scipy.special.ndtr(np.linspace(-TABLE_END, TABLE_END, 513))  # Φ, to be interpolated linearly
TABLE_ERROR = 2e-5  # above what the interpolation is wrong by: h² / 8 times the largest |Φ''|, 0.242, is 1.7e-5
NEGLIGIBLE = 40.0  # entries whose log odds are lower by this than the nearest one's add nothing to a float64


@dataclass(frozen=True, eq=False)
class Tree:
    """n entries in 2^b leaves. A node's right child holds the entries at or above its split.

    coefficients: (n, b) float32, in the entries' own order. order: (n,) the entries sorted by leaf.
    starts: (2^b + 1,) where each leaf begins in `order`. splits: (2^b − 1,) in heap order: the children of node k are
    2k + 1 and 2k + 2; a node at level l splits component l. rows: (n, b) float32, the coefficients in that order,
    so that a leaf's are fetched together.
    """

    coefficients: Float32Array
    order: IntArray
    starts: IntArray
    splits: Float32Array
    rows: Float32Array

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
    order = np.argsort(codes, kind="stable")
    splits = np.zeros((1 << b) - 1, dtype=np.float32)
    return Tree(coefficients, order, starts, splits, coefficients[order])


def median_tree(coefficients: Float32Array) -> Tree:
    """The balanced tree the paper mentions: a node of level l splits the median of component l among its entries."""
    coefficients = _checked(coefficients)
    n, b = coefficients.shape
    starts = np.arange((1 << b) + 1, dtype=np.int64) * n >> b
    splits = np.zeros((1 << b) - 1, dtype=np.float32)
    order = np.arange(n)
    _sort_by_halves(coefficients, starts, order, splits)
    return Tree(coefficients, order, starts, splits, coefficients[order])


def draw(tree: Tree, probes: FloatArray, beta: float, uniforms: FloatArray, leaf: str = "gaussian") -> IntArray:
    """One entry (N,) for each probe (N, b) by probabilistic search (C, eq. 7 and 8).

    At level l the search goes right with probability Φ((c_t,l − split) / (√β σ_l)). A branch without entries is never
    taken: its sibling is, with probability one. In the leaf an entry is drawn by p(c_i | c_t) at the same temperature
    ("gaussian") or with equal odds ("uniform"). uniforms: (N, b + 1) in [0, 1), one per level and one for the leaf.
    """
    _check_search(tree, probes, beta, leaf)
    probes, leaves = np.ascontiguousarray(probes, dtype=np.float64), np.empty(len(probes), dtype=np.int64)
    _descend(tree.starts, tree.splits, probes, beta, uniforms, leaves)
    firsts, sizes = tree.starts[leaves], tree.starts[leaves + 1] - tree.starts[leaves]
    if leaf == "uniform":
        places = np.minimum((uniforms[:, -1] * sizes).astype(np.int64), sizes - 1)
    else:
        places = np.empty(len(probes), dtype=np.int64)
        # leaf after leaf, so that each is fetched once, and equal probes, such as a parent's children, share its odds
        turns = np.argsort(leaves, kind="stable")
        _pick(tree.rows, probes, firsts, sizes, turns, beta, uniforms[:, -1], places)
    return tree.order[firsts + places]


def log_proposal(tree: Tree, probe: FloatArray, beta: float, leaf: str = "gaussian") -> FloatArray:
    """log q(i | c_t), (n,), the log probability with which `draw` returns each entry for one probe (b,)."""
    _check_search(tree, probe[None], beta, leaf)
    whole = np.zeros(1)
    for level in range(tree.depth):
        bounds = tree.starts[:: 1 << (tree.depth - level - 1)]
        left, right = np.diff(bounds).reshape(-1, 2).T > 0
        offset = (probe[level] - tree.splits[(1 << level) - 1 : (2 << level) - 1]) / np.sqrt(beta)
        with np.errstate(divide="ignore"):
            odds = np.log(np.stack([scipy.special.ndtr(-offset), scipy.special.ndtr(offset)], axis=1))
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


def _checked(coefficients: Float32Array) -> Float32Array:
    if coefficients.ndim != 2 or len(coefficients) == 0 or not 1 <= coefficients.shape[1] <= 30:
        raise InputError(f"tree: expected coefficients (n, b) with 1 ≤ b ≤ 30, found {coefficients.shape}")
    return np.ascontiguousarray(coefficients, dtype=np.float32)


def _check_search(tree: Tree, probes: FloatArray, beta: float, leaf: str) -> None:
    if probes.shape[1:] != (tree.depth,) or not np.isfinite(probes).all():
        raise ValueError(f"probes must be finite (N, {tree.depth}), found {probes.shape}")
    if not beta > 0.0:
        raise InputError(f"prior: the temperature beta must be positive, found {beta}")
    if leaf not in LEAVES:
        raise InputError(f"prior: leaf must be one of {', '.join(LEAVES)}, found {leaf!r}")


@kernel(error_model="numpy")
def _descend(starts: Any, splits: Any, probes: Any, beta: float, uniforms: Any, leaves: Any) -> None:
    n_levels = probes.shape[1]
    deviation = math.sqrt(beta)
    for i in range(probes.shape[0]):
        node, low, high = 0, 0, 1 << n_levels
        for level in range(n_levels):
            middle = (low + high) // 2
            goes_right = starts[high] > starts[middle]
            if goes_right and starts[middle] > starts[low]:
                goes_right = _is_below(uniforms[i, level], (probes[i, level] - splits[node]) / deviation)
            node = 2 * node + (2 if goes_right else 1)
            if goes_right:
                low = middle
            else:
                high = middle
        leaves[i] = low


@kernel(error_model="numpy")
def _is_below(uniform: float, x: float) -> Any:
    """Return whether uniform < Φ(x): a table tells nearly always, and the function itself where that might be wrong."""
    cell = (min(max(x, -TABLE_END), TABLE_END) + TABLE_END) * (TABLE.shape[0] - 1) / (2.0 * TABLE_END)
    k = min(int(cell), TABLE.shape[0] - 2)
    above = TABLE[k] + (cell - k) * (TABLE[k + 1] - TABLE[k]) - uniform
    if abs(above) > TABLE_ERROR:
        return above > 0.0
    return uniform < 0.5 * math.erfc(-x / math.sqrt(2.0))


@kernel(error_model="numpy")
def _pick(rows: Any, probes: Any, firsts: Any, sizes: Any, turns: Any, beta: float, uniforms: Any, places: Any) -> None:
    """The place in its leaf of every draw, by p(c_i | c_t) among the leaf's entries; in the order of `turns`."""
    odds, before = np.empty(sizes.max()), -1
    for i in turns:
        if before < 0 or firsts[i] != firsts[before] or not _equal(probes[i], probes[before]):
            _leaf_odds(rows, firsts[i], sizes[i], probes[i], beta, odds)
        last, before = sizes[i] - 1, i
        places[i] = np.searchsorted(odds[:last], uniforms[i] * odds[last], side="right")


@kernel(error_model="numpy")
def _equal(a: Any, b: Any) -> bool:
    same = True
    for k in range(a.shape[0]):  # an array of what differs would cost more than the rest of a draw
        same &= a[k] == b[k]
    return same


@inlined
def _leaf_odds(rows: Any, first: int, size: int, probe: Any, beta: float, odds: Any) -> None:
    """The running sum of exp(−|c_i − c_t|² / 2β) over a leaf's entries, relative to the nearest."""
    nearest = np.inf
    for j in range(size):
        square = 0.0
        for k in range(probe.shape[0]):
            away = rows[first + j, k] - probe[k]
            square += away * away
        odds[j] = square / (2.0 * beta)
        nearest = min(nearest, odds[j])
    total = 0.0
    for j in range(size):
        if odds[j] - nearest < NEGLIGIBLE:
            total += math.exp(nearest - odds[j])
        odds[j] = total


@kernel()
def _sort_by_halves(coefficients: Any, starts: Any, order: Any, splits: Any) -> None:
    """Level by level, sort every node's entries by the level's component, so that `starts` cuts it in halves."""
    n_leaves = starts.shape[0] - 1
    values = np.empty(order.shape[0], dtype=coefficients.dtype)
    width, level = n_leaves, 0
    while width > 1:
        for node in range(n_leaves // width):
            first, middle, last = starts[node * width], starts[node * width + width // 2], starts[(node + 1) * width]
            for j in range(first, last):
                values[j] = coefficients[order[j], level]
            order[first:last] = order[first:last][np.argsort(values[first:last], kind="mergesort")]
            if first < middle < last:
                below, above = coefficients[order[middle - 1], level], coefficients[order[middle], level]
                splits[n_leaves // width - 1 + node] = 0.5 * (below + above)
        width, level = width // 2, level + 1


@dataclass(frozen=True)
class Fidelity:
    """Means over probes. total_variation: ½ Σ |q − p|. distance: median |c_i − c_t|² of draws from q, whitened, over
    all probes; exact_distance: that of draws from p. visited: part of the entries whose distance was computed.
    effective: effective number of entries 1 / Σ p², the median.
    """

    total_variation: float
    distance: float
    exact_distance: float
    visited: float
    effective: float


def total_variation(p: FloatArray, q: FloatArray) -> float:
    """½ Σ |p − q| of two distributions (n,): 0 when they are the same, 1 when they share nothing."""
    return 0.5 * float(np.abs(p - q).sum())


def fidelity(
    tree: Tree | KdTree, coefficients: Float32Array, probes: FloatArray, beta: float, rng: np.random.Generator, *,
    leaf: str = "gaussian", tail_probability: float = 0.01,
) -> Fidelity:  # fmt: skip
    """Compare the search's distribution with the exact one by enumeration, for probes (K, b) over all entries (n, b).

    Only the distances are sampled, by 100 draws a probe from either distribution.
    """
    variations, visited, effective, distances, exact_distances = [], [], [], [], []
    for probe in probes:
        exact = np.exp(exact_log_prob(coefficients, probe, beta))
        q, n_visited = _distribution(tree, probe, beta, leaf, tail_probability)
        squares = ((coefficients - probe) ** 2).sum(axis=1)
        uniforms = rng.random(100)
        variations.append(total_variation(exact, q))
        visited.append(n_visited / len(coefficients))
        effective.append(1.0 / (exact**2).sum())
        distances.append(squares[_inverse(q, uniforms)])
        exact_distances.append(squares[_inverse(exact, uniforms)])
    return Fidelity(
        total_variation=float(np.mean(variations)), distance=float(np.median(distances)),
        exact_distance=float(np.median(exact_distances)), visited=float(np.mean(visited)),
        effective=float(np.median(effective)),
    )  # fmt: skip


def log_importance(tree: Tree, probe: FloatArray, entries: IntArray, beta: float, leaf: str = "gaussian") -> FloatArray:
    """log p(c_i | c_t) − log q(i | c_t), (N,), for entries (N,) that a tree's search drew for one probe (b,).

    The paper's footnote 3 in its plainest form: the tree is the proposal q, eq. 6 at the same temperature the target,
    and both are known, q as the product of the branches' probabilities on the way to the entry. A filter multiplies a
    particle's weight by the exponential. Both are computed for all entries, so this costs a scan per probe.
    """
    return exact_log_prob(tree.coefficients, probe, beta)[entries] - log_proposal(tree, probe, beta, leaf)[entries]


def _distribution(
    tree: Tree | KdTree, probe: FloatArray, beta: float, leaf: str, tail_probability: float
) -> tuple[FloatArray, float]:
    """The distribution (n,) a search draws from, and the mean number of entries it computes a distance to."""
    if isinstance(tree, KdTree):
        return found_distribution(tree, probe, beta, tail_probability)
    q = np.exp(log_proposal(tree, probe, beta, leaf))
    if leaf == "uniform":
        return q, 0.0
    sizes = np.diff(tree.starts)
    return q, float((q[tree.order] * np.repeat(sizes, sizes)).sum())


def _inverse(distribution: FloatArray, uniforms: FloatArray) -> IntArray:
    cumulative = distribution.cumsum()
    places = np.searchsorted(cumulative, uniforms * cumulative[-1], side="right")
    return np.minimum(places, len(cumulative) - 1)
