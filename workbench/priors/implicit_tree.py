"""Paper C's binary tree over the coefficients of windows, and its probabilistic search (C, sections 4.1 and 4.2).

The tree is flat: the entries are sorted by leaf, and each of the 2^b leaf codes has the number of entries before it.
The node of a level-l prefix p is the range of codes [p 2^(b−l), (p + 1) 2^(b−l)); its number of entries is a difference
of two counts, without pointers. All coefficients are whitened, c_i,l / σ_l. The fidelity of a search as a sampler of
p(c_i | c_t) is computed by enumeration.
"""

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
import scipy

from workbench.body.simd_kinematics import inlined
from workbench.priors.implicit_search import KdTree, exact_log_prob, search_distribution
from workbench.utils.arrays import Float32Array, FloatArray, IntArray
from workbench.utils.errors import InputError
from workbench.utils.kernel_cache import kernel

LEAVES = ("gaussian", "uniform")
TABLE_END = 6.0
TABLE = scipy.special.ndtr(np.linspace(-TABLE_END, TABLE_END, 513))  # Φ, interpolated linearly
TABLE_ERROR = 2e-5  # above the interpolation error, h² / 8 times the maximum of |Φ''|, 0.242: 1.7e-5
NEGLIGIBLE = 40.0  # log weight below the nearest entry's at which an entry is negligible in float64


@dataclass(frozen=True, eq=False)
class Tree:
    """n entries in 2^b leaves. A node's right child holds the entries at or above its split.

    coefficients : (n, b) float32, in the order of the entries. order : (n,) the entries sorted by leaf. starts :
    (2^b + 1,) the first position of each leaf in `order`. splits : (2^b − 1,) in heap order: the children of node k are
    2k + 1 and 2k + 2; a node at level l splits component l. rows : (n, b) float32, the coefficients in the order of
    `order`, contiguous within a leaf.
    """

    coefficients: Float32Array
    order: IntArray
    starts: IntArray
    splits: Float32Array
    rows: Float32Array

    @property
    def depth(self) -> int:
        """b, the number of levels."""
        return int(self.coefficients.shape[1])


def sign_tree(coefficients: Float32Array) -> Tree:
    """Return the paper's tree: level l splits on the sign of component l. coefficients : (n, b), whitened, b ≤ 30."""
    coefficients = _checked(coefficients)
    b = coefficients.shape[1]
    codes = (coefficients >= 0.0) @ (1 << np.arange(b - 1, -1, -1, dtype=np.int64))
    starts = np.concatenate([[0], np.cumsum(np.bincount(codes, minlength=1 << b))])
    order = np.argsort(codes, kind="stable")
    splits = np.zeros((1 << b) - 1, dtype=np.float32)
    return Tree(coefficients, order, starts, splits, coefficients[order])


def median_tree(coefficients: Float32Array) -> Tree:
    """Return the balanced tree that the paper mentions: a node of level l splits at the median of component l."""
    coefficients = _checked(coefficients)
    n, b = coefficients.shape
    starts = np.arange((1 << b) + 1, dtype=np.int64) * n >> b
    splits = np.zeros((1 << b) - 1, dtype=np.float32)
    order = np.arange(n)
    _sort_by_halves(coefficients, starts, order, splits)
    return Tree(coefficients, order, starts, splits, coefficients[order])


def draw(tree: Tree, probes: FloatArray, beta: float, uniforms: FloatArray, leaf: str = "gaussian") -> IntArray:
    """Sample one entry (N,) for each probe (N, b) by probabilistic search (C, eq. 7 and 8).

    At level l the search goes right with probability Φ((c_t,l − split) / (√β σ_l)). An empty branch has probability
    zero. In the leaf an entry is sampled from p(c_i | c_t) at the same temperature ("gaussian") or uniformly
    ("uniform"). uniforms : (N, b + 1) in [0, 1), one per level and one for the leaf.
    """
    _check_search(tree, probes, beta, leaf)
    probes, leaves = np.ascontiguousarray(probes, dtype=np.float64), np.empty(len(probes), dtype=np.int64)
    _descend(tree.starts, tree.splits, probes, beta, uniforms, leaves)
    firsts, sizes = tree.starts[leaves], tree.starts[leaves + 1] - tree.starts[leaves]
    if leaf == "uniform":
        places = np.minimum((uniforms[:, -1] * sizes).astype(np.int64), sizes - 1)
    else:
        places = np.empty(len(probes), dtype=np.int64)
        # leaf after leaf: each is fetched once, and equal probes, such as a parent's children, share its weights
        order = np.argsort(leaves, kind="stable")
        _sample_in_leaves(tree.rows, probes, firsts, sizes, order, beta, uniforms[:, -1], places)
    return tree.order[firsts + places]


def log_proposal(tree: Tree, probe: FloatArray, beta: float, leaf: str = "gaussian") -> FloatArray:
    """Return log q(i | c_t), (n,), the log probability of each entry in `draw` for one probe (b,)."""
    _check_search(tree, probe[None], beta, leaf)
    log_leaf = np.zeros(1)
    for level in range(tree.depth):
        bounds = tree.starts[:: 1 << (tree.depth - level - 1)]
        left, right = np.diff(bounds).reshape(-1, 2).T > 0
        offset = (probe[level] - tree.splits[(1 << level) - 1 : (2 << level) - 1]) / np.sqrt(beta)
        with np.errstate(divide="ignore"):
            log_branch = np.log(np.stack([scipy.special.ndtr(-offset), scipy.special.ndtr(offset)], axis=1))
        log_branch[left & ~right] = (0.0, -np.inf)
        log_branch[right & ~left] = (-np.inf, 0.0)
        log_leaf = (log_leaf[:, None] + log_branch).ravel()
    sizes = np.diff(tree.starts)
    full = sizes > 0
    inside = np.zeros(len(tree.order))
    if leaf == "gaussian":
        squares = ((tree.coefficients[tree.order].astype(np.float64) - probe) ** 2).sum(axis=1)
        inside = -squares / (2.0 * beta)
    within = inside - np.repeat(np.logaddexp.reduceat(inside, tree.starts[:-1][full]), sizes[full])
    log_prob = np.empty(len(tree.order))
    log_prob[tree.order] = np.repeat(log_leaf[full], sizes[full]) + within
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
    """Return whether uniform < Φ(x), by a table where its error cannot matter, else by the function itself."""
    cell = (min(max(x, -TABLE_END), TABLE_END) + TABLE_END) * (TABLE.shape[0] - 1) / (2.0 * TABLE_END)
    k = min(int(cell), TABLE.shape[0] - 2)
    above = TABLE[k] + (cell - k) * (TABLE[k + 1] - TABLE[k]) - uniform
    if abs(above) > TABLE_ERROR:
        return above > 0.0
    return uniform < 0.5 * math.erfc(-x / math.sqrt(2.0))


@kernel(error_model="numpy")
def _sample_in_leaves(
    rows: Any, probes: Any, firsts: Any, sizes: Any, order: Any, beta: float, uniforms: Any, places: Any
) -> None:
    """Sample the position of an entry in its leaf by p(c_i | c_t), for every probe, in the given order."""
    weights, before = np.empty(sizes.max()), -1
    for i in order:
        if before < 0 or firsts[i] != firsts[before] or not _equal(probes[i], probes[before]):
            _cumulative_weights(rows, firsts[i], sizes[i], probes[i], beta, weights)
        last, before = sizes[i] - 1, i
        places[i] = np.searchsorted(weights[:last], uniforms[i] * weights[last], side="right")


@kernel(error_model="numpy")
def _equal(a: Any, b: Any) -> bool:
    same = True
    for k in range(a.shape[0]):  # a temporary array would cost more than the rest of a sample
        same &= a[k] == b[k]
    return same


@inlined
def _cumulative_weights(rows: Any, first: int, size: int, probe: Any, beta: float, weights: Any) -> None:
    """Compute the cumulative sum of exp(−|c_i − c_t|² / 2β) over a leaf's entries, relative to the nearest."""
    nearest = np.inf
    for j in range(size):
        square = 0.0
        for k in range(probe.shape[0]):
            difference = rows[first + j, k] - probe[k]
            square += difference * difference
        weights[j] = square / (2.0 * beta)
        nearest = min(nearest, weights[j])
    total = 0.0
    for j in range(size):
        if weights[j] - nearest < NEGLIGIBLE:
            total += math.exp(nearest - weights[j])
        weights[j] = total


@kernel()
def _sort_by_halves(coefficients: Any, starts: Any, order: Any, splits: Any) -> None:
    """Sort every node's entries by the component of its level, so that `starts` splits it in halves."""
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
    """Means over probes of a search's accuracy as a sampler.

    total_variation : ½ Σ |q − p|. distance : median |c_i − c_t|² of samples from q, whitened, over all probes.
    exact_distance : that of samples from p. visited : fraction of the entries whose distance was computed. effective :
    median effective number of entries 1 / Σ p².
    """

    total_variation: float
    distance: float
    exact_distance: float
    visited: float
    effective: float


def total_variation(p: FloatArray, q: FloatArray) -> float:
    """Return ½ Σ |p − q| of two distributions (n,): 0 if they are equal, 1 if they are disjoint."""
    return 0.5 * float(np.abs(p - q).sum())


def fidelity(
    tree: Tree | KdTree, coefficients: Float32Array, probes: FloatArray, beta: float, rng: np.random.Generator, *,
    leaf: str = "gaussian", tail_probability: float = 0.01,
) -> Fidelity:  # fmt: skip
    """Compare the search's distribution with the exact one by enumeration, for probes (K, b) over all entries (n, b).

    Only the distances are estimated by sampling, with 100 samples per probe from either distribution.
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
    """Return the log importance weights log p(c_i | c_t) − log q(i | c_t), (N,), of entries (N,) for a probe (b,).

    The paper's footnote 3 in its simplest form: the tree is the proposal q, and eq. 6 at the same temperature the
    target. q is the product of the branch probabilities on the path to the entry. Both are computed for all entries, by
    a linear scan per probe.
    """
    return exact_log_prob(tree.coefficients, probe, beta)[entries] - log_proposal(tree, probe, beta, leaf)[entries]


def _distribution(
    tree: Tree | KdTree, probe: FloatArray, beta: float, leaf: str, tail_probability: float
) -> tuple[FloatArray, float]:
    """Return the distribution (n,) of a search, and the mean number of distances it computes."""
    if isinstance(tree, KdTree):
        return search_distribution(tree, probe, beta, tail_probability)
    q = np.exp(log_proposal(tree, probe, beta, leaf))
    if leaf == "uniform":
        return q, 0.0
    sizes = np.diff(tree.starts)
    return q, float((q[tree.order] * np.repeat(sizes, sizes)).sum())


def _inverse(distribution: FloatArray, uniforms: FloatArray) -> IntArray:
    cumulative = distribution.cumsum()
    places = np.searchsorted(cumulative, uniforms * cumulative[-1], side="right")
    return np.minimum(places, len(cumulative) - 1)
