"""Draws from the exact p(c_i | c_t) of paper C (eq. 6) without looking at most of the database.

A kd-tree with tight bounding boxes is descended nearest child first. With exp(−distance² / 2β) the weight of an entry,
and the distance to its box a bound for it, something is passed over for one of two reasons:

- each of its entries weighs at most ε/2n of the mass found so far, so that all n of them miss at most ε/2 of it;
- all its entries together may use up PORTION of what is left of another ε/2, which is kept account of.

So the draws miss at most the part ε of the mass, and the total variation between their distribution and p is at most ε
(far less in practice: most entries are farther than their box). One search serves any number of draws from its probe.
All coefficients are whitened, c_i,l / σ_l.
"""

import math
from dataclasses import dataclass
from typing import Any

import numba
import numpy as np
from scipy.special import logsumexp

from workbench.arrays import Float32Array, FloatArray, IntArray
from workbench.errors import InputError
from workbench.priors.implicit_tree import balanced_order

LEAF_SIZE = 8
PORTION = 0.01
"""How much of what is left of ε/2 one box may use up: small enough to last, large enough to spare visits (measured)."""
LANES = 8
"""Coefficients are padded with zeros to a multiple of this, so that distances are computed in whole vectors."""
FASTMATH = {"reassoc", "contract", "nsz", "arcp"}


@dataclass(frozen=True, eq=False)
class KdTree:
    """n entries in 2^h leaves of at most LEAF_SIZE.

    coefficients: (n, b) float32, sorted by leaf, b padded to whole LANES. order: (n,) which entry each row is.
    starts: (2^h + 1,) the rows where the leaves begin. boxes: (2^(h+1) − 1, 2, b) float32, lowest and highest
    coefficients of every node, in heap order. n_components: b without padding.
    """

    coefficients: Float32Array
    order: IntArray
    starts: IntArray
    boxes: Float32Array
    n_components: int


@dataclass(frozen=True, eq=False)
class Found:
    """What a search brought back for K probes and their N draws.

    entries: (N,). visited: (K,) entries whose distance was computed. log_mass: (K,) log Σ_i exp(−|c_i − c_t|² / 2β),
    the log normaliser of eq. 6, short by at most ε of the mass.
    """

    entries: IntArray
    visited: IntArray
    log_mass: FloatArray


def kd_tree(coefficients: Float32Array) -> KdTree:
    """A balanced kd-tree over whitened coefficients (n, b); every node is halved across its widest side."""
    if coefficients.ndim != 2 or 0 in coefficients.shape:
        raise InputError(f"kd-tree: expected coefficients (n, b), found {coefficients.shape}")
    n_components, coefficients = coefficients.shape[1], _padded(coefficients)
    depth = max(0, math.ceil(math.log2(len(coefficients) / LEAF_SIZE)))
    order, starts = balanced_order(coefficients, depth)
    coefficients = coefficients[order]
    boxes = [np.stack([edge.reduceat(coefficients, starts[:-1], axis=0) for edge in (np.minimum, np.maximum)], axis=1)]
    while len(boxes[0]) > 1:
        left, right = boxes[0][0::2], boxes[0][1::2]
        boxes.insert(0, np.stack([np.minimum(left[:, 0], right[:, 0]), np.maximum(left[:, 1], right[:, 1])], axis=1))
    return KdTree(coefficients, order, starts, np.concatenate(boxes), n_components)


def search(
    tree: KdTree, probes: FloatArray, counts: IntArray, beta: float, uniforms: FloatArray, epsilon: float = 0.01
) -> Found:
    """Draw counts[k] entries for every probe k (K, b) from p(c_i | c_t) ∝ exp(−|c_i − c_t|² / 2β) (C, eq. 6).

    β = 1 is eq. 6 itself; the temperature scales its variances as in eq. 7. uniforms: (Σ counts,) in [0, 1), probe
    after probe, as are the entries that come back. epsilon: the part of the mass that may be missed.
    """
    _check(tree, probes, beta, epsilon)
    if counts.shape != (len(probes),) or counts.sum() != len(uniforms):
        raise ValueError(f"counts must be {len(probes)} numbers with the sum {len(uniforms)}")
    entries, ends = np.empty(len(uniforms), dtype=np.int64), np.cumsum(counts)
    visited, log_mass = np.empty(len(probes), dtype=np.int64), np.empty(len(probes))
    _search(
        tree.coefficients, tree.order, tree.starts, tree.boxes, _padded(probes), ends, beta, epsilon,
        uniforms, entries, visited, log_mass,
    )  # fmt: skip
    return Found(entries, visited, log_mass)


def found_distribution(tree: KdTree, probe: FloatArray, beta: float, epsilon: float = 0.01) -> tuple[FloatArray, int]:
    """The distribution (n,) that `search` draws from for one probe (b,), and how many entries it visited for it."""
    _check(tree, probe[None], beta, epsilon)
    n = len(tree.order)
    weights, found = np.empty(n), np.empty(n, dtype=np.int64)
    stack, squares = np.empty(128, dtype=np.int64), np.empty(128, dtype=np.float32)
    n_found, visited, _, _ = _open(
        tree.coefficients, tree.starts, tree.boxes, _padded(probe[None])[0], beta, epsilon,
        weights, found, stack, squares,
    )  # fmt: skip
    distribution = np.zeros(n)
    distribution[tree.order[found[:n_found]]] = weights[:n_found] / weights[:n_found].sum()
    return distribution, int(visited)


def found_distribution_reference(
    tree: KdTree, probe: FloatArray, beta: float, epsilon: float = 0.01
) -> tuple[FloatArray, int]:
    """The same as `found_distribution` in plain NumPy, by recursion."""
    n_inner, n = len(tree.starts) - 2, len(tree.order)
    probe = _padded(probe[None])[0]
    exponents = np.full(n, np.inf)  # of the rows found, in the tree's order
    visited, log_spent = 0, -np.inf  # the bound of the mass passed over for the second reason

    def box_exponent(node: int) -> float:
        gap = np.maximum(np.maximum(tree.boxes[node, 0] - probe, probe - tree.boxes[node, 1]), 0.0)
        return float(gap @ gap) / (2.0 * beta)

    def log_share() -> float:
        return float(np.log(epsilon / 2.0) + logsumexp(-exponents)) if np.isfinite(exponents).any() else -np.inf

    def descend(node: int) -> None:
        nonlocal visited, log_spent
        if -box_exponent(node) < log_share() - np.log(n):
            return
        log_cost = np.log(_count(tree.starts, node)) - box_exponent(node)
        if np.exp(log_cost - log_share()) <= PORTION * (1.0 - np.exp(log_spent - log_share())):
            log_spent = np.logaddexp(log_spent, log_cost)
            return
        if node < n_inner:
            for child in sorted((2 * node + 1, 2 * node + 2), key=box_exponent):
                descend(child)
            return
        rows = slice(*tree.starts[node - n_inner : node - n_inner + 2])
        visited += rows.stop - rows.start
        found = ((tree.coefficients[rows] - probe) ** 2).sum(axis=1) / (2.0 * beta)
        exponents[rows] = np.where(-found >= log_share() - np.log(n), found, np.inf)

    with np.errstate(invalid="ignore"):  # −∞ − (−∞) before anything is found: nan, which is never passed over
        descend(0)
    distribution = np.empty(n)
    distribution[tree.order] = np.exp(-exponents - logsumexp(-exponents))
    return distribution, visited


def exact_log_prob(coefficients: Float32Array, probe: FloatArray, beta: float) -> FloatArray:
    """log p(c_i | c_t), (n,), by looking at every entry (C, eq. 6); probe: (b,), all whitened."""
    exponents = -((coefficients - probe.astype(np.float64)) ** 2).sum(axis=1) / (2.0 * beta)
    log_prob: FloatArray = exponents - logsumexp(exponents)
    return log_prob


def _padded(rows: FloatArray | Float32Array) -> Float32Array:
    missing = -rows.shape[1] % LANES
    return np.ascontiguousarray(np.pad(rows, ((0, 0), (0, missing))), dtype=np.float32)


def _check(tree: KdTree, probes: FloatArray, beta: float, epsilon: float) -> None:
    if probes.ndim != 2 or probes.shape[1] != tree.n_components or not np.isfinite(probes).all():
        raise ValueError(f"probes must be finite (K, {tree.n_components}), found {probes.shape}")
    if not beta > 0.0:
        raise InputError(f"prior: the temperature beta must be positive, found {beta}")
    if not 0.0 < epsilon < 1.0:
        raise InputError(f"prior: epsilon must lie between 0 and 1, found {epsilon}")


@numba.njit(cache=True, nogil=True)
def _search(
    coefficients: Any, order: Any, starts: Any, boxes: Any, probes: Any, ends: Any, beta: float, epsilon: float,
    uniforms: Any, entries: Any, visited: Any, log_mass: Any,
) -> None:  # fmt: skip
    weights, found = np.empty(order.shape[0]), np.empty(order.shape[0], dtype=np.int64)
    stack, squares = np.empty(128, dtype=np.int64), np.empty(128, dtype=np.float32)
    first = 0
    for k in range(probes.shape[0]):
        n_found, visited[k], mass, base = _open(
            coefficients, starts, boxes, probes[k], beta, epsilon, weights, found, stack, squares
        )
        log_mass[k] = math.log(mass) - base
        total = 0.0
        for j in range(n_found):
            total += weights[j]
            weights[j] = total
        for i in range(first, ends[k]):
            place = np.searchsorted(weights[:n_found], uniforms[i] * total, side="right")
            entries[i] = order[found[min(place, n_found - 1)]]
        first = ends[k]


@numba.njit(cache=True, nogil=True)
def _open(
    coefficients: Any, starts: Any, boxes: Any, probe: Any, beta: float, epsilon: float,
    weights: Any, found: Any, stack: Any, squares: Any,
) -> Any:  # fmt: skip
    """Fill `weights` and `found` with the rows near the probe; return (number found, visited, mass, base).

    Weights are exp(base − exponent), base being the smallest exponent so far: they are re-based when a nearer entry
    appears, so that nothing underflows at low temperatures. `stack` and `squares` are room for two nodes a level.
    """
    n_inner, per_square = starts.shape[0] - 2, 1.0 / (2.0 * beta)
    log_rarity, log_portion = math.log(2.0 * coefficients.shape[0] / epsilon), math.log(2.0 / (PORTION * epsilon))
    mass, base, spent, reach, edge = 0.0, 0.0, 0.0, np.inf, np.inf
    n_found, n_visited, top = 0, 0, 1
    stack[0], squares[0] = 0, np.float32(0.0)
    while top > 0:
        top -= 1
        node = stack[top]
        bound = squares[top] * per_square
        if bound > reach:
            continue
        if bound > edge:  # below it the cost is too high even for a single entry
            cost = _count(starts, node) * math.exp(base - bound)
            if cost <= PORTION * (0.5 * epsilon * mass - spent):
                spent += cost
                continue
        if node < n_inner:
            left, right = _box_square(boxes, 2 * node + 1, probe), _box_square(boxes, 2 * node + 2, probe)
            near = 0 if right < left else 1  # the nearer child goes on top
            stack[top + near], squares[top + near] = 2 * node + 1, left
            stack[top + 1 - near], squares[top + 1 - near] = 2 * node + 2, right
            top += 2
            continue
        first, last = starts[node - n_inner], starts[node - n_inner + 1]
        n_visited += last - first
        farthest, n_before = reach, n_found
        for row in range(first, last):
            exponent = _square(coefficients, row, probe) * per_square
            if exponent > farthest:
                continue
            if n_found == 0:
                base = exponent
            elif exponent < base:
                factor = math.exp(exponent - base)
                base, mass, spent = exponent, mass * factor, spent * factor
                for j in range(n_found):
                    weights[j] *= factor
            weights[n_found], found[n_found] = math.exp(base - exponent), row
            mass += weights[n_found]
            n_found += 1
        if n_found > n_before:
            reach = base + log_rarity - math.log(mass)
            edge = base + log_portion - math.log(mass)
    return n_found, n_visited, mass, base


@numba.njit(cache=True, nogil=True)
def _count(starts: Any, node: int) -> Any:
    """The entries below a node in heap order."""
    n_leaves, first, width = starts.shape[0] - 1, node + 1, 1
    while first < n_leaves:
        first, width = 2 * first, 2 * width
    return starts[first - n_leaves + width] - starts[first - n_leaves]


@numba.njit(cache=True, nogil=True, fastmath=FASTMATH)
def _square(coefficients: Any, row: int, probe: Any) -> Any:
    square = np.float32(0.0)
    for k in range(probe.shape[0]):
        away = coefficients[row, k] - probe[k]
        square += away * away
    return square


@numba.njit(cache=True, nogil=True, fastmath=FASTMATH)
def _box_square(boxes: Any, node: int, probe: Any) -> Any:
    square = np.float32(0.0)
    for k in range(probe.shape[0]):
        gap = max(max(boxes[node, 0, k] - probe[k], probe[k] - boxes[node, 1, k]), np.float32(0.0))
        square += gap * gap
    return square
