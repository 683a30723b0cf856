"""The implicit prior's tree, exact search and density in plain NumPy, one probe at a time (paper C, sections 3 and 4).

For `workbench.priors.implicit_tree`, `implicit_search` and `implicit_density`. All coefficients are whitened.
"""

import numpy as np
import scipy

from workbench.priors.density import SAME
from workbench.priors.implicit_density import WindowDisplacements
from workbench.priors.implicit_search import BINS, LANES, KdTree, exact_log_prob, padded
from workbench.priors.implicit_tree import Tree
from workbench.utils.arrays import FloatArray, IntArray


def draw(tree: Tree, probes: FloatArray, beta: float, uniforms: FloatArray, leaf: str = "gaussian") -> IntArray:
    """Draw an entry (N,) for each probe (N, b) by probabilistic search (C, eq. 7 and 8), level by level.

    beta : temperature. uniforms : (N, b + 1) numbers in [0, 1), one for each level and one for the leaf. leaf : how an
    entry of the leaf is drawn: by its probability ("gaussian") or with equal odds ("uniform").
    """
    entries = np.empty(len(probes), dtype=np.int64)
    for i, (probe, uniform) in enumerate(zip(probes, uniforms, strict=True)):
        node, low, high = 0, 0, 1 << tree.depth
        for level in range(tree.depth):
            middle = (low + high) // 2
            left, right = tree.starts[middle] - tree.starts[low], tree.starts[high] - tree.starts[middle]
            odds = scipy.special.ndtr((probe[level] - tree.splits[node]) / np.sqrt(beta))
            goes_right = right > 0 and (left == 0 or uniform[level] < odds)
            node = 2 * node + 1 + goes_right
            low, high = (middle, high) if goes_right else (low, middle)
        inside = tree.order[tree.starts[low] : tree.starts[high]]
        if leaf == "uniform":
            odds = np.full(len(inside), 1.0 / len(inside)).cumsum()
        else:
            odds = np.exp(exact_log_prob(tree.coefficients[inside], probe, beta)).cumsum()
        entries[i] = inside[min(np.searchsorted(odds, uniform[-1] * odds[-1], side="right"), len(inside) - 1)]
    return entries


def search_distribution(tree: KdTree, probe: FloatArray, beta: float, epsilon: float = 0.01) -> tuple[FloatArray, int]:
    """Return the distribution (n,) that the search draws from for one probe (b,), and its number of distances.

    beta : temperature. epsilon : the fraction of the probability mass that the search may omit. A distance is computed
    for each entry of the leaves that are scanned.
    """
    probe, n = padded(probe[None])[0], len(tree.order)
    exponents = np.full(n, np.inf)  # of the scanned places
    scanned: list[int] = []

    def scan(leaf: int) -> None:
        places = slice(leaf * LANES, min((leaf + 1) * LANES, n))
        inside = tree.coefficients[leaf].T[: places.stop - places.start]
        distances = ((inside - probe) ** 2).sum(axis=1) / (2.0 * beta)
        exponents[places] = np.where(distances < farthest, distances, np.inf)
        scanned.append(leaf)

    def log_mass() -> float:
        return float(scipy.special.logsumexp(-exponents))

    groups, leaves = (
        (np.maximum(np.maximum(boxes[:, :, 0] - p, p - boxes[:, :, 1]), 0.0) ** 2).sum(axis=1).ravel() / (2.0 * beta)
        for p in [probe[:, None]]
        for boxes in (tree.group_boxes, tree.leaf_boxes)
    )
    farthest, nearest = np.inf, int(groups.argmin()) * LANES
    scan(nearest + int(leaves[nearest : nearest + LANES].argmin()))
    reach = np.log(2.0 * n / epsilon) - log_mass()
    low = groups.min()
    near = np.flatnonzero((leaves <= reach) & (np.repeat(groups, LANES)[: len(leaves)] <= reach))
    scale = (BINS - 1) / (reach - low)
    bins = ((leaves[near] - low) * scale).astype(np.int64)
    remaining = (
        np.log(LANES) - low - np.arange(BINS) / scale + np.log(np.maximum(np.bincount(bins, minlength=BINS), 1e-300))
    )
    for i in np.unique(bins):
        if scipy.special.logsumexp(remaining[i:]) <= np.log(0.5 * epsilon) + log_mass():
            break
        farthest = np.log(2.0 * n / epsilon) - log_mass()
        for leaf in near[bins == i]:
            if leaf != scanned[0]:
                scan(leaf)
    distribution = np.empty(n)
    distribution[tree.order] = np.exp(-exponents - scipy.special.logsumexp(-exponents))
    return distribution, sum(min(LANES, n - leaf * LANES) for leaf in scanned)


def log_mixture(
    tree: KdTree, probe: FloatArray, beta: float, epsilon: float, windows: WindowDisplacements, white: FloatArray
) -> FloatArray:
    """Return the density's log terms log p(i | c) N(d; d_i, Σ), (n,), for one probe c (b,) and displacement d (K,).

    They are −∞ for windows that the search omits or that have another displacement without noise. windows, white : the
    displacements over their standard deviations. beta, epsilon : see `search_distribution`.
    """
    distribution, _ = search_distribution(tree, probe, beta, epsilon)
    entries = np.flatnonzero(distribution)
    errors = windows.whitened[entries] - white
    noisy = len(windows.std)
    terms = np.full(len(windows.whitened), -np.inf)
    terms[entries] = np.log(distribution[entries]) - 0.5 * (errors[:, :noisy] ** 2).sum(axis=1)
    terms[entries] -= np.log(np.sqrt(2.0 * np.pi) * windows.std).sum()
    terms[entries[(np.abs(errors[:, noisy:]) > SAME).any(axis=1)]] = -np.inf
    return terms
