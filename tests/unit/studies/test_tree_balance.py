"""The balance of the sign tree: node sizes against direct counts, and metrics of trees of known shape."""

import numpy as np
import pytest

from workbench.motion.models.windows import learn_windows
from workbench.motion.synthetic.gait import builtin_motions
from workbench.priors.implicit import Implicit
from workbench.priors.implicit_tree import sign_tree
from workbench.studies.tree_balance import TreeBalance, balance, by_size, node_sizes


@pytest.fixture(scope="module")
def prior():
    return Implicit(learn_windows([motion.resampled(30.0) for motion in builtin_motions(n_subjects=4)]))


@pytest.fixture(scope="module")
def result(prior):
    return TreeBalance(prior).run(np.random.default_rng(0))


def test_the_nodes_of_a_level_contain_the_entries_with_their_signs(prior):
    tree = sign_tree(prior.windows.coefficients)
    for level in (0, 1, 3):
        signs = prior.windows.coefficients[:, :level] >= 0.0
        codes = (signs * 2 ** np.arange(level)[::-1]).sum(axis=1)
        assert node_sizes(tree, level).tolist() == np.bincount(codes, minlength=1 << level).tolist()


def test_metrics_of_a_full_tree_and_of_a_single_path():
    """One tree has every sign pattern of three components once, the other eight entries of one pattern."""
    signs = np.array([[1 - 2 * (code >> level & 1) for level in range(3)] for code in range(8)], dtype=np.float32)
    assert balance(sign_tree(signs)) == {
        "empty_pct": 0.0, "largest_leaf": 1.0, "leaf_size": 1.0, "bits": pytest.approx(3.0), "one_child_pct": 0.0,
    }  # fmt: skip
    assert balance(sign_tree(np.ones((8, 3), dtype=np.float32))) == {
        "empty_pct": 87.5, "largest_leaf": 8.0, "leaf_size": 8.0, "bits": pytest.approx(0.0), "one_child_pct": 100.0,
    }  # fmt: skip


def test_leaves_are_grouped_by_powers_of_two():
    of_leaves, of_entries = by_size(np.array([0, 1, 2, 3, 4, 0, 0, 10]), 5)
    assert of_leaves.tolist() == [37.5, 12.5, 25.0, 12.5, 12.5]
    assert of_entries.tolist() == [0.0, 5.0, 25.0, 20.0, 50.0]


def test_recorded_motion_fills_fewer_leaves_than_independent_components(result, prior):
    metrics = result.metrics
    assert metrics["empty_pct"] > metrics["empty_pct_shuffled"]
    assert metrics["leaf_size"] > metrics["leaf_size_gaussian"]
    assert metrics["bits"] < metrics["bits_gaussian"] < np.log2(metrics["n_entries"])
    n, b = prior.windows.coefficients.shape
    assert (metrics["n_entries"], metrics["n_levels"]) == (n, b)
    assert metrics["largest_leaf_median"] == np.ceil(n / 2**b)
    # independent signs: a leaf is empty with probability (1 − 2^−b)^n
    assert metrics["empty_pct_gaussian"] == pytest.approx(100.0 * (1.0 - 0.5**b) ** n, rel=0.1)
