"""How faithfully a search of paper C's database samples p(c_i | c_t), and the weights that make up for it."""

from dataclasses import dataclass

import numpy as np

from workbench.priors.implicit_search import KdTree, exact_log_prob, found_distribution
from workbench.priors.implicit_tree import Tree, log_proposal
from workbench.utils.arrays import Float32Array, FloatArray, IntArray


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
    leaf: str = "gaussian", epsilon: float = 0.01,
) -> Fidelity:  # fmt: skip
    """Compare the search's distribution with the exact one by enumeration, for probes (K, b) over all entries (n, b).

    Only the distances are sampled, by 100 draws a probe from either distribution.
    """
    variations, visited, effective, distances, exact_distances = [], [], [], [], []
    for probe in probes:
        exact = np.exp(exact_log_prob(coefficients, probe, beta))
        q, n_visited = _distribution(tree, probe, beta, leaf, epsilon)
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
    tree: Tree | KdTree, probe: FloatArray, beta: float, leaf: str, epsilon: float
) -> tuple[FloatArray, float]:
    """The distribution (n,) a search draws from, and the mean number of entries it computes a distance to."""
    if isinstance(tree, KdTree):
        return found_distribution(tree, probe, beta, epsilon)
    q = np.exp(log_proposal(tree, probe, beta, leaf))
    if leaf == "uniform":
        return q, 0.0
    sizes = np.diff(tree.starts)
    return q, float((q[tree.order] * np.repeat(sizes, sizes)).sum())


def _inverse(distribution: FloatArray, uniforms: FloatArray) -> IntArray:
    cumulative = distribution.cumsum()
    places = np.searchsorted(cumulative, uniforms * cumulative[-1], side="right")
    return np.minimum(places, len(cumulative) - 1)
