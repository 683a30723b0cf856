"""Balance of paper C's binary tree: sizes of leaves, and entries left to search by level (C, section 4.1)."""

from collections.abc import Mapping

import numpy as np

from workbench.core.prior import Prior
from workbench.core.study import Bars, Curves, StudyResult
from workbench.priors.implicit import Implicit
from workbench.priors.implicit_tree import Tree, median_tree, sign_tree
from workbench.utils.arrays import FloatArray, IntArray
from workbench.utils.errors import InputError

RECORDED, SHUFFLED, GAUSSIAN, MEDIAN = "recorded", "shuffled", "Gaussian", "split at medians"
METRICS = {RECORDED: "", SHUFFLED: "_shuffled", GAUSSIAN: "_gaussian", MEDIAN: "_median"}


class TreeBalance:
    """Leaves of the sign tree and its balance, compared with trees of independent coefficients (C, section 4.1).

    Four trees have the same number of entries and components: the database's; the same with each component shuffled
    over the entries, which preserves the fraction of each sign and removes dependence between components; independent
    standard Gaussians; and the database split at medians, which is balanced by construction.

    Metrics, with suffix _shuffled, _gaussian or _median: empty_pct (of all 2^b leaves), largest_leaf, leaf_size (mean
    over entries of the size of their leaf), bits (entropy of the leaf of an entry, at most log₂ n), and one_child_pct
    (of the non-empty nodes above the leaves). n_entries, n_levels.
    """

    def __init__(self, prior: Prior) -> None:
        self.prior = prior

    def run(self, rng: np.random.Generator) -> StudyResult:
        """Build and measure the four trees. Raises InputError for a prior without a database."""
        if not isinstance(self.prior, Implicit):
            raise InputError("study: expected an implicit prior, such as prior=implicit")
        recorded = self.prior.windows.coefficients
        trees = {
            RECORDED: sign_tree(recorded),
            SHUFFLED: sign_tree(rng.permuted(recorded, axis=0)),
            GAUSSIAN: sign_tree(rng.standard_normal(recorded.shape).astype(np.float32)),
            MEDIAN: median_tree(recorded),
        }
        n, b = recorded.shape
        metrics = {"n_entries": float(n), "n_levels": float(b)}
        for name, tree in trees.items():
            metrics |= {f"{key}{METRICS[name]}": value for key, value in balance(tree).items()}
        return StudyResult(metrics, (*_leaves(trees), *_levels(trees)), _note(metrics))


def node_sizes(tree: Tree, level: int) -> IntArray:
    """Return the sizes of all 2^level nodes of a level, from 0, the root, to b, the leaves."""
    return np.diff(tree.starts[:: 1 << (tree.depth - level)])


def balance(tree: Tree) -> dict[str, float]:
    """Return a tree's metrics, see `TreeBalance`."""
    leaves = node_sizes(tree, tree.depth)
    fractions = leaves[leaves > 0] / leaves.sum()
    pairs = np.concatenate([node_sizes(tree, level + 1).reshape(-1, 2) for level in range(tree.depth)])
    nonempty = pairs.sum(axis=1) > 0
    return {
        "empty_pct": 100.0 * float((leaves == 0).mean()),
        "largest_leaf": float(leaves.max()),
        "leaf_size": _mean_node_size(leaves),
        "bits": float(-(fractions * np.log2(fractions)).sum()),
        "one_child_pct": 100.0 * float((pairs[nonempty] == 0).any(axis=1).mean()),
    }


def _mean_node_size(sizes: IntArray) -> float:
    """Return the mean over entries of the size of their node."""
    return float((sizes.astype(np.float64) ** 2).sum() / sizes.sum())


def by_size(leaves: IntArray, n_classes: int) -> tuple[FloatArray, FloatArray]:
    """Return the percentages of leaves and of entries by class of leaf size: 0, 1, 2–3, 4–7 …."""
    size_class = np.where(leaves > 0, np.floor(np.log2(np.maximum(leaves, 1))) + 1, 0).astype(np.int64)
    of_leaves = np.bincount(size_class, minlength=n_classes) / len(leaves)
    of_entries = np.bincount(size_class, weights=leaves, minlength=n_classes) / leaves.sum()
    return 100.0 * of_leaves, 100.0 * of_entries


def _leaves(trees: Mapping[str, Tree]) -> tuple[Bars, ...]:
    sizes = {name: node_sizes(trees[name], trees[name].depth) for name in (RECORDED, GAUSSIAN)}
    n_classes = int(np.log2(max(each.max() for each in sizes.values()))) + 2
    percentages = {name: by_size(each, n_classes) for name, each in sizes.items()}
    x, x_name = np.arange(n_classes, dtype=np.float64), "leaf size class: 0, 1, 2–3, 4–7 …"
    return tuple(
        Bars(f"leaves/{what}", x, percentages[RECORDED][k], x_name, percentages[GAUSSIAN][k])
        for k, what in enumerate(("% of the leaves", "% of the entries"))
    )


def _levels(trees: Mapping[str, Tree]) -> tuple[Curves, ...]:
    depth = trees[RECORDED].depth
    x = np.arange(depth + 1, dtype=np.float64)
    left, one_child, above = {}, {}, {}
    for name, tree in trees.items():
        left[name] = np.log10([_mean_node_size(node_sizes(tree, level)) for level in range(depth + 1)])
        pairs = [node_sizes(tree, level + 1).reshape(-1, 2) for level in range(depth)]
        nonempty = [each[each.sum(axis=1) > 0] for each in pairs]
        one_child[name] = np.array([np.nan, *(100.0 * (each == 0).any(axis=1).mean() for each in nonempty)])
        above[name] = np.array([np.nan, *(100.0 * each[:, 1].sum() / each.sum() for each in nonempty)])
    level = "level"
    return (
        Curves("levels/left to search", x, left, level, "log₁₀ entries in an entry's node"),
        Curves("levels/nodes with one child", x, one_child, level, "% of the nodes above"),
        Curves("levels/right of the split", x, above, level, "% of the entries"),
    )


def _note(metrics: Mapping[str, float]) -> str:
    return (
        f"**Paper C, section 4.1.** The sign tree of {metrics['n_entries']:.0f} windows in 2^{metrics['n_levels']:.0f} "
        "leaves. Bars: the recorded database; dashed: as many windows with independent Gaussian coefficients. The "
        "components of recorded motion are uncorrelated, not independent: most leaves are empty, and the others have "
        f"up to {metrics['largest_leaf']:.0f} entries. The second page compares these trees level by level with trees "
        "of shuffled components and of splits at medians."
    )
