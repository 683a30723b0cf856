"""Samples from the exact p(c_i | c_t) of paper C (eq. 6) with sub-linear cost in the size of the database.

The entries are partitioned into leaves of LANES neighbours, the leaves into groups of LANES, as by a kd-tree; each has
a tight bounding box. The weight of an entry is exp(−distance² / 2β), and the distance to its box bounds it. A search
starts from the nearest leaf and prunes

- entries that each weigh at most ε/2n of the mass so far, so that all n of them omit at most ε/2 of it;
- the remaining leaves, nearest first, when all of them together weigh at most ε/2 of the mass.

So a search omits at most the fraction ε (tail_probability) of the mass, and the total variation between its
distribution and p is at most ε (far less in practice: most entries are farther than their box). One search serves any
number of samples from its probe. All coefficients are whitened, c_i,l / σ_l.

Performance (n = 10⁵, β = 0.05: 2.8 µs per sample on one thread, 20 samples per search): the coefficients of a leaf's
entries, and the boxes of a group's leaves, are contiguous, so that LANES distances are computed at once; two layers of
boxes replace a binary tree's fourteen; nodes are split across the component of largest variance, not of largest range,
which is sensitive to outliers. Binning by distance is cheaper than sorting.
"""

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
import scipy

from workbench.body.simd_kinematics import FAST, inlined, inlined_exactly
from workbench.utils.arrays import Float32Array, FloatArray, IntArray
from workbench.utils.errors import InputError
from workbench.utils.kernel_cache import kernel
from workbench.utils.parallel import parallel_for

LANES = 32
"""Entries per leaf and leaves per group: enough to fill the vectors, few enough to prune most of them whole."""
BINS = 64
PROBES = 16  # fewest per thread
STRIDE = 4
"""Coefficients are padded with zeros to a multiple of this, the number that one pass over the lanes adds up."""
MAX_COEFFICIENT = 1e15  # of a probe, so that no squared distance overflows


@dataclass(frozen=True, eq=False)
class KdTree:
    """n entries in L leaves of LANES, and the leaves in G groups of LANES; the last of each may be partly empty.

    coefficients : (L, b, LANES) float32, inf where empty; b padded to whole STRIDEs. order : (n,) the entry at each
    position, leaf after leaf. leaf_boxes : (G, b, 2, LANES) float32, lower and upper coefficients of the leaves of each
    group, inf where empty. group_boxes : (⌈G / LANES⌉, b, 2, LANES), of the groups. n_components : b without padding.
    """

    coefficients: Float32Array
    order: IntArray
    leaf_boxes: Float32Array
    group_boxes: Float32Array
    n_components: int


@dataclass(frozen=True, eq=False)
class _SearchResult:
    """Result of a search for K probes with N samples.

    entries : (N,). visited : (K,) numbers of computed distances. log_mass : (K,) log Σ_i exp(−|c_i − c_t|² / 2β), log
    normaliser of eq. 6, without at most the fraction ε of the mass.
    """

    entries: IntArray
    visited: IntArray
    log_mass: FloatArray


def kd_tree(coefficients: Float32Array) -> KdTree:
    """Return the leaves, groups and boxes of whitened coefficients (n, b)."""
    if coefficients.ndim != 2 or 0 in coefficients.shape:
        raise InputError(f"kd-tree: expected coefficients (n, b), found {coefficients.shape}")
    n_components, coefficients = coefficients.shape[1], padded(coefficients)
    order = _leaf_order(coefficients)
    leaves = _blocks(coefficients[order], np.inf)
    lower, upper = leaves.min(axis=2), _blocks(coefficients[order], -np.inf).max(axis=2)
    groups = [_blocks(edge, np.inf) for edge in (lower, upper)]
    bounds = [_blocks(edge, empty) for edge, empty in ((lower, np.inf), (upper, -np.inf))]
    group_edges = [bounds[0].min(axis=2), bounds[1].max(axis=2)]
    group_boxes = np.stack([_blocks(edge, np.inf) for edge in group_edges], axis=2)
    return KdTree(leaves, order, np.stack(groups, axis=2), group_boxes, n_components)


def _leaf_order(coefficients: Float32Array) -> IntArray:
    """Return the entries (n,) leaf after leaf: split at the component of largest variance, at whole groups."""
    order = np.arange(len(coefficients))
    leaf_ranges = [(0, -(-len(order) // LANES))]
    while leaf_ranges:
        first, last = leaf_ranges.pop()
        if last - first < 2:
            continue
        unit = LANES if last - first > LANES else 1
        middle = first + unit * max(1, round((last - first) / (2 * unit)))
        inside = order[first * LANES : last * LANES]
        values = coefficients[inside]
        component = int(values.var(axis=0).argmax())
        split = np.argpartition(values[:, component], (middle - first) * LANES)
        order[first * LANES : last * LANES] = inside[split]
        leaf_ranges += [(first, middle), (middle, last)]
    return order


def _blocks(rows: Float32Array, empty: float) -> Float32Array:
    """Return rows (n, b) as (⌈n / LANES⌉, b, LANES), the last block padded."""
    filled = np.pad(rows, ((0, -len(rows) % LANES), (0, 0)), constant_values=empty)
    return np.ascontiguousarray(filled.reshape(-1, LANES, rows.shape[1]).transpose(0, 2, 1))


def search(
    tree: KdTree, probes: FloatArray, counts: IntArray, beta: float, uniforms: FloatArray,
    tail_probability: float = 0.01,
) -> _SearchResult:  # fmt: skip
    """Sample counts[k] entries for every probe k (K, b) from p(c_i | c_t) ∝ exp(−|c_i − c_t|² / 2β) (C, eq. 6).

    β = 1 is eq. 6 itself; the temperature scales its variances as in eq. 7. Probes are distributed over numba's
    threads; the result does not depend on their number. uniforms : (Σ counts,) in [0, 1), probe after probe, as are the
    sampled entries. tail_probability : ε, the fraction of the mass that may be omitted.
    """
    check_probes(tree, probes, beta, tail_probability)
    if counts.shape != (len(probes),) or counts.sum() != len(uniforms):
        raise ValueError(f"counts must be {len(probes)} numbers with the sum {len(uniforms)}")
    entries, ends = np.empty(len(uniforms), dtype=np.int64), np.cumsum(counts)
    visited, log_mass = np.empty(len(probes), dtype=np.int64), np.empty(len(probes))
    arguments = (
        tree.coefficients, tree.order, tree.leaf_boxes, tree.group_boxes, padded(probes), ends, beta, tail_probability,
        uniforms, entries, visited, log_mass,
    )  # fmt: skip
    parallel_for(lambda first, last: _search(first, last, *arguments), len(probes), PROBES)
    return _SearchResult(entries, visited, log_mass)


def search_distribution(
    tree: KdTree, probe: FloatArray, beta: float, tail_probability: float = 0.01
) -> tuple[FloatArray, int]:
    """Return the distribution (n,) of `search` for one probe (b,), and the number of computed distances."""
    check_probes(tree, probe[None], beta, tail_probability)
    n = len(tree.order)
    weights, positions = np.empty(n), np.empty(n, dtype=np.int64)
    n_candidates, visited = _open_one(
        tree.coefficients, tree.leaf_boxes, tree.group_boxes, padded(probe[None])[0], n, beta, tail_probability,
        weights, positions,
    )  # fmt: skip
    distribution = np.zeros(n)
    distribution[tree.order[positions[:n_candidates]]] = weights[:n_candidates] / weights[:n_candidates].sum()
    return distribution, int(visited)


def exact_log_prob(coefficients: Float32Array, probe: FloatArray, beta: float) -> FloatArray:
    """Return log p(c_i | c_t), (n,), by a linear scan (C, eq. 6); probe : (b,), all whitened."""
    exponents = -((coefficients - probe.astype(np.float64)) ** 2).sum(axis=1) / (2.0 * beta)
    return exponents - scipy.special.logsumexp(exponents)


def group_equal(probes: FloatArray) -> tuple[IntArray, IntArray]:
    """Return an order (N,) in which equal rows of (N, b) are adjacent, and the first position of each group of them.

    Rows are sorted by the first coefficient only, which in practice differs between unequal rows; where it does not, a
    probe may be searched more than once.
    """
    order = np.argsort(probes[:, 0], kind="stable")
    sorted_probes = probes[order]
    changes = (sorted_probes[1:] != sorted_probes[:-1]).any(axis=1)
    return order, np.flatnonzero(np.append(True, changes)[: len(order)])


def nearest_entries(tree: KdTree, probes: FloatArray, beta: float, tail_probability: float = 0.01) -> IntArray:
    """Return the most probable entry (K,) for every probe (K, b), which is the nearest."""
    check_probes(tree, probes, beta, tail_probability)
    entries = np.empty(len(probes), dtype=np.int64)
    arguments = (
        tree.coefficients, tree.order, tree.leaf_boxes, tree.group_boxes, padded(probes), beta, tail_probability,
        entries,
    )  # fmt: skip
    parallel_for(lambda first, last: _nearest(first, last, *arguments), len(probes), PROBES)
    return entries


def padded(rows: FloatArray | Float32Array) -> Float32Array:
    """Return rows (n, b) padded with zeros to a whole number of STRIDEs."""
    n_padding = -rows.shape[1] % STRIDE
    return np.ascontiguousarray(np.pad(rows, ((0, 0), (0, n_padding))), dtype=np.float32)


def check_probes(tree: KdTree, probes: FloatArray, beta: float, tail_probability: float) -> None:
    """Raise ValueError for probes of a wrong shape or size, InputError for parameters out of range."""
    if probes.ndim != 2 or probes.shape[1] != tree.n_components or not (np.abs(probes) <= MAX_COEFFICIENT).all():
        raise ValueError(
            f"probes must be (K, {tree.n_components}) and within ±{MAX_COEFFICIENT:g}, found {probes.shape}"
        )
    if not beta > 0.0:
        raise InputError(f"prior: the temperature beta must be positive, found {beta}")
    if not 0.0 < tail_probability < 1.0:
        raise InputError(f"prior: tail_probability must lie between 0 and 1, found {tail_probability}")


@kernel(error_model="numpy")
def _search(
    first: int, last: int,
    coefficients: Any, order: Any, leaf_boxes: Any, group_boxes: Any, probes: Any, ends: Any, beta: float,
    tail_probability: float, uniforms: Any, entries: Any, visited: Any, log_mass: Any,
) -> None:  # fmt: skip
    n = order.shape[0]
    weights, positions = np.empty(n), np.empty(n, dtype=np.int64)
    for k in range(first, last):
        n_candidates, visited[k], mass, base = _open(
            coefficients, leaf_boxes, group_boxes, probes[k], n, beta, tail_probability, weights, positions
        )
        log_mass[k] = math.log(mass) - base
        total = 0.0
        for j in range(n_candidates):
            total += weights[j]
            weights[j] = total
        for i in range(ends[k - 1] if k > 0 else 0, ends[k]):
            drawn = np.searchsorted(weights[:n_candidates], uniforms[i] * total, side="right")
            entries[i] = order[positions[min(drawn, n_candidates - 1)]]


@kernel(error_model="numpy")
def _nearest(
    first: int, last: int,
    coefficients: Any, order: Any, leaf_boxes: Any, group_boxes: Any, probes: Any, beta: float, tail_probability: float,
    entries: Any,
) -> None:  # fmt: skip
    n = order.shape[0]
    log_prob, candidates = np.empty(n), np.empty(n, dtype=np.int64)
    for k in range(first, last):
        n_candidates = search_entries(
            coefficients, order, leaf_boxes, group_boxes, probes[k], beta, tail_probability, log_prob, candidates
        )
        entries[k] = candidates[log_prob[:n_candidates].argmax()]


@inlined_exactly
def search_entries(
    coefficients: Any, order: Any, leaf_boxes: Any, group_boxes: Any, probe: Any, beta: float, tail_probability: float,
    log_prob: Any, entries: Any,
) -> Any:  # fmt: skip
    """Fill `entries` (n,) and `log_prob` (n,) with the entries of a search for a padded probe and their log
    probabilities; return their number."""
    n_entries, _, mass, _ = _open(
        coefficients, leaf_boxes, group_boxes, probe, order.shape[0], beta, tail_probability, log_prob, entries
    )
    for j in range(n_entries):
        log_prob[j], entries[j] = np.log(log_prob[j] / mass), order[entries[j]]
    return n_entries


@kernel(error_model="numpy")
def _open_one(
    coefficients: Any, leaf_boxes: Any, group_boxes: Any, probe: Any, n: int, beta: float, tail_probability: float,
    weights: Any, positions: Any,
) -> tuple[int, int]:  # fmt: skip
    n_candidates, visited, _, _ = _open(
        coefficients, leaf_boxes, group_boxes, probe, n, beta, tail_probability, weights, positions
    )
    return n_candidates, visited


@inlined_exactly
def _open(
    coefficients: Any, leaf_boxes: Any, group_boxes: Any, probe: Any, n: int, beta: float, tail_probability: float,
    weights: Any, positions: Any,
) -> Any:  # fmt: skip
    """Fill `weights` and `positions` with the entries near the probe; return (their number, visited, mass, base).

    Weights are exp(base − exponent), where base is the smallest exponent so far; they are rescaled when a nearer entry
    appears, so that nothing underflows at low temperatures.
    """
    squares, log_threshold = np.empty(LANES, dtype=np.float32), math.log(2.0 * n / tail_probability)
    groups = np.empty((group_boxes.shape[0], LANES), dtype=np.float32)
    for i in range(group_boxes.shape[0]):
        _box_squares(group_boxes, i, probe, groups[i])
    nearest = groups.argmin()
    low = groups.ravel()[nearest]
    _box_squares(leaf_boxes, nearest, probe, squares)
    first = nearest * LANES + squares.argmin()
    _squares(coefficients, first, probe, squares)
    base, mass, n_candidates = _add_leaf(squares, first, beta, np.float32(np.inf), np.inf, 0.0, 0, weights, positions)
    n_visited, near_base = min(LANES, n - first * LANES), base
    reach = np.float32(2.0 * beta * (base + log_threshold - math.log(mass)))
    leaves, ends, remaining = _near_leaves(leaf_boxes, groups.ravel(), probe, low, reach, beta, base)
    j = 0
    for i in range(BINS):
        if ends[i] == j:
            continue
        if remaining[i] * math.exp(base - near_base) <= 0.5 * tail_probability * mass:
            break
        farthest = np.float32(2.0 * beta * (base + log_threshold - math.log(mass)))
        while j < ends[i]:
            if leaves[j] != first:
                _squares(coefficients, leaves[j], probe, squares)
                base, mass, n_candidates = _add_leaf(
                    squares, leaves[j], beta, farthest, base, mass, n_candidates, weights, positions
                )
                n_visited += min(LANES, n - leaves[j] * LANES)
            j += 1
    return n_candidates, n_visited, mass, base


@inlined_exactly
def _near_leaves(leaf_boxes: Any, groups: Any, probe: Any, low: Any, reach: Any, beta: float, base: float) -> Any:
    """Return the leaves with boxes within `reach` of the probe (squared), sorted into BINS between `low` and `reach`.

    Also return the end of each bin, and an upper bound of the weight of its and all later leaves, relative to `base`.
    """
    n_groups = leaf_boxes.shape[0]
    near, squares = np.empty(n_groups * LANES, dtype=np.int64), np.empty(n_groups * LANES, dtype=np.float32)
    inside, n_near = np.empty(LANES, dtype=np.float32), 0
    for group in range(n_groups):
        if groups[group] <= reach:
            _box_squares(leaf_boxes, group, probe, inside)
            for lane in range(LANES):  # without a branch, which would be mispredicted half the time
                near[n_near], squares[n_near] = group * LANES + lane, inside[lane]
                n_near += inside[lane] <= reach
    per_square = np.float32(BINS - 1) / max(reach - low, np.float32(1e-30))
    ends, remaining = np.zeros(BINS + 1, dtype=np.int64), np.zeros(BINS + 1)
    for j in range(n_near):
        ends[_bin(squares[j], low, per_square) + 1] += 1
    for i in range(BINS - 1, -1, -1):
        remaining[i] = remaining[i + 1] + ends[i + 1] * LANES * math.exp(base - (low + i / per_square) / (2.0 * beta))
    for i in range(BINS):
        ends[i + 1] += ends[i]
    leaves = np.empty(n_near, dtype=np.int64)
    for j in range(n_near):
        i = _bin(squares[j], low, per_square)
        leaves[ends[i]] = near[j]
        ends[i] += 1  # moves from the start of the bin to its end
    return leaves, ends, remaining


@inlined_exactly
def _bin(square: Any, low: Any, per_square: Any) -> int:
    return int(max((square - low) * per_square, np.float32(0.0)))  # rounding may put a leaf before its group


@inlined_exactly
def _add_leaf(
    squares: Any, leaf: Any, beta: float, farthest: Any, base: float, mass: float, n_candidates: int, weights: Any,
    positions: Any,
) -> Any:  # fmt: skip
    """Add a leaf's entries nearer than `farthest` (squared) to the candidates; return (base, mass, their number)."""
    for lane in range(LANES):
        if squares[lane] < farthest:
            exponent = squares[lane] / (2.0 * beta)
            if exponent < base:
                if n_candidates > 0:
                    factor = math.exp(exponent - base)
                    mass *= factor
                    for j in range(n_candidates):
                        weights[j] *= factor
                base = exponent
            weights[n_candidates], positions[n_candidates] = math.exp(base - exponent), leaf * LANES + lane
            mass += weights[n_candidates]
            n_candidates += 1
    return base, mass, n_candidates


@inlined
def _squares(coefficients: Any, leaf: Any, probe: Any, squares: Any) -> None:
    """Compute |c_i − c_t|² of the leaf's entries; four coefficients per pass reduce loads and stores."""
    for lane in range(LANES):
        squares[lane] = np.float32(0.0)
    for k in range(0, probe.shape[0], STRIDE):
        p0, p1, p2, p3 = probe[k], probe[k + 1], probe[k + 2], probe[k + 3]
        for lane in range(LANES):
            a0, a1 = coefficients[leaf, k, lane] - p0, coefficients[leaf, k + 1, lane] - p1
            a2, a3 = coefficients[leaf, k + 2, lane] - p2, coefficients[leaf, k + 3, lane] - p3
            squares[lane] += a0 * a0 + a1 * a1 + a2 * a2 + a3 * a3


@inlined
def _box_squares(boxes: Any, group: Any, probe: Any, squares: Any) -> None:
    """Compute the squared distances from the probe to the LANES boxes of a group, 0 inside."""
    for lane in range(LANES):
        squares[lane] = np.float32(0.0)
    for k in range(0, probe.shape[0], STRIDE):
        p0, p1, p2, p3 = probe[k], probe[k + 1], probe[k + 2], probe[k + 3]
        for lane in range(LANES):
            a0 = _gap(boxes[group, k, 0, lane], p0, boxes[group, k, 1, lane])
            a1 = _gap(boxes[group, k + 1, 0, lane], p1, boxes[group, k + 1, 1, lane])
            a2 = _gap(boxes[group, k + 2, 0, lane], p2, boxes[group, k + 2, 1, lane])
            a3 = _gap(boxes[group, k + 3, 0, lane], p3, boxes[group, k + 3, 1, lane])
            squares[lane] += a0 * a0 + a1 * a1 + a2 * a2 + a3 * a3


@kernel(fastmath=FAST, error_model="numpy", inline="always")
def _gap(low: Any, value: Any, high: Any) -> Any:
    return max(max(low - value, value - high), np.float32(0.0))
