"""The searches of the implicit prior against enumeration."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.stats import chisquare, norm

from tests.oracles import implicit as oracle
from workbench.priors.implicit_search import LANES, exact_log_prob, kd_tree, search, search_distribution
from workbench.priors.implicit_tree import draw, fidelity, log_proposal, median_tree, sign_tree, total_variation
from workbench.utils.errors import InputError

TREES = {"sign": sign_tree, "median": median_tree}


def database(n=300, b=8, seed=0):
    """Clustered coefficients, so that sign leaves differ in size and many are empty."""
    rng = np.random.default_rng(seed)
    centres = rng.normal(size=(12, b))
    return (centres[rng.integers(12, size=n)] + 0.3 * rng.normal(size=(n, b))).astype(np.float32)


def brute_force_log_prob(coefficients, probe, beta):
    weights = [np.exp(-0.5 * sum((c - p) ** 2 for c, p in zip(row, probe, strict=True)) / beta) for row in coefficients]
    return np.log(np.array(weights) / np.sum(weights))


def test_the_exact_probabilities_are_equation_6():
    coefficients, probe = database(20, 3).astype(np.float64), np.array([0.2, -0.4, 0.1])
    expected = brute_force_log_prob(coefficients, probe, 0.7)
    assert exact_log_prob(coefficients, probe, 0.7) == pytest.approx(expected, abs=1e-9)


def goodness_of_fit(entries, probabilities):
    """p value of a chi-square test of draws against their probabilities; cells under 5 expected draws are pooled."""
    expected = probabilities * len(entries)
    observed = np.bincount(entries, minlength=len(probabilities))
    assert (observed[probabilities == 0] == 0).all()
    common = expected >= 5
    cells = [np.append(counts[common], counts[~common].sum()) for counts in (observed, expected)]
    occupied = cells[1] > 1e-6
    observed, expected = (counts[occupied] for counts in cells)
    return chisquare(observed, expected * observed.sum() / expected.sum()).pvalue


@pytest.mark.parametrize("kind", TREES)
@pytest.mark.parametrize("leaf", ["gaussian", "uniform"])
@pytest.mark.parametrize("beta", [0.05, 1.0])
def test_draws_have_the_trees_probabilities(kind, leaf, beta):
    coefficients, rng = database(), np.random.default_rng(3)
    tree = TREES[kind](coefficients)
    probe = coefficients[7] + 0.3 * rng.normal(size=8)
    log_q = log_proposal(tree, probe, beta, leaf)
    assert np.exp(log_q).sum() == pytest.approx(1.0, abs=1e-9)
    entries = draw(tree, np.repeat(probe[None], 20000, axis=0), beta, rng.random((20000, 9)), leaf)
    assert goodness_of_fit(entries, np.exp(log_q)) > 1e-4  # a correct sampler fails with one seed in 10⁴


def test_the_probability_of_a_leaf_is_the_product_along_its_path():
    """Four entries in the four quadrants: equations 7 and 8 written out."""
    coefficients = np.array([[1, 1], [1, -1], [-1, 1], [-1, -1]], dtype=np.float32)
    probe, beta = np.array([0.3, -0.5]), 0.4
    right = norm.cdf(probe / np.sqrt(beta))
    expected = [right[0] * right[1], right[0] * (1 - right[1]), (1 - right[0]) * right[1], (1 - right).prod()]
    assert np.exp(log_proposal(sign_tree(coefficients), probe, beta)) == pytest.approx(expected, rel=1e-9)


def test_an_empty_branch_is_never_taken():
    coefficients = np.array([[1.0, 1.0], [1.0, -1.0], [2.0, -3.0]], dtype=np.float32)
    probe = np.array([-4.0, 4.0])  # at level 0 it belongs to the left, which has no entry
    q = np.exp(log_proposal(sign_tree(coefficients), probe, 0.5))
    assert q.sum() == pytest.approx(1.0)
    entries = draw(sign_tree(coefficients), probe[None], 0.5, np.array([[0.9, 0.1, 0.0]]))
    assert entries == [0]


def test_the_median_tree_is_balanced_and_split_at_its_medians():
    coefficients = database(300, 8)
    tree = median_tree(coefficients)
    assert set(np.diff(tree.starts)) <= {1, 2}
    assert sorted(tree.order) == list(range(300))
    left, right = tree.order[: tree.starts[128]], tree.order[tree.starts[128] :]
    assert coefficients[left, 0].max() <= tree.splits[0] <= coefficients[right, 0].min()


@settings(max_examples=30)
@given(
    n=st.integers(1, 60),
    b=st.integers(1, 6),
    seed=st.integers(0, 10**6),
    beta=st.floats(1e-3, 10.0),
    leaf=st.sampled_from(["gaussian", "uniform"]),
    kind=st.sampled_from(sorted(TREES)),
)
def test_the_tree_kernel_agrees_with_numpy(n, b, seed, beta, leaf, kind):
    rng = np.random.default_rng(seed)
    tree = TREES[kind](rng.normal(size=(n, b)).astype(np.float32))
    probes, uniforms = rng.normal(size=(25, b)), rng.random((25, b + 1))
    entries = draw(tree, probes, beta, uniforms, leaf)
    assert (entries == oracle.draw(tree, probes, beta, uniforms, leaf)).all()
    for entry, probe in zip(entries, probes, strict=True):
        assert log_proposal(tree, probe, beta, leaf)[entry] > -np.inf


@settings(max_examples=40)
@given(
    n=st.integers(1, 1500),
    b=st.integers(1, 17),
    seed=st.integers(0, 10**6),
    beta=st.floats(1e-3, 10.0),
    tail_probability=st.floats(1e-4, 0.5),
    spread=st.floats(0.0, 5.0),
)
def test_the_search_omits_at_most_the_tail_probability(n, b, seed, beta, tail_probability, spread):
    rng = np.random.default_rng(seed)
    coefficients = rng.normal(size=(n, b)).astype(np.float32)
    coefficients[n // 2 :] = coefficients[: n - n // 2]  # repeated entries
    probe = spread * rng.normal(size=b)
    tree = kd_tree(coefficients)
    searched, visited = search_distribution(tree, probe, beta, tail_probability)
    exact = np.exp(exact_log_prob(coefficients, probe.astype(np.float32), beta))
    # float32 distances: 1e-6 of the square, over 2β in the exponent
    rounding = 1e-6 * ((coefficients - probe) ** 2).sum(axis=1).max() / beta
    assert total_variation(searched, exact) <= tail_probability + rounding
    assert 1 <= visited <= n


def test_the_search_kernel_agrees_with_numpy():
    coefficients, rng = database(2700, 11), np.random.default_rng(5)
    tree = kd_tree(coefficients)
    for probe in rng.normal(size=(10, 11)):
        searched, visited = search_distribution(tree, probe, 0.1)
        expected, expected_visited = oracle.search_distribution(tree, probe, 0.1)
        assert searched == pytest.approx(expected, rel=1e-3, abs=1e-9)  # float32 distances over 2β
        assert visited == expected_visited


@pytest.mark.parametrize("n", [1, LANES, 333, 2 * LANES**2 + 5])
def test_the_leaves_and_boxes_hold_their_entries(n):
    coefficients = database(n, 5)
    tree = kd_tree(coefficients)
    assert sorted(tree.order) == list(range(n))
    leaves = np.split(tree.order, range(LANES, n, LANES))
    for leaf, inside in enumerate(leaves):
        assert (coefficients[inside] == tree.coefficients[leaf, :5, : len(inside)].T).all()
        box = tree.leaf_boxes[leaf // LANES, :5, :, leaf % LANES]
        assert ([coefficients[inside].min(axis=0), coefficients[inside].max(axis=0)] == box.T).all()
    for group, first in enumerate(range(0, len(leaves), LANES)):
        inside = np.concatenate(leaves[first : first + LANES])
        box = tree.group_boxes[group // LANES, :5, :, group % LANES]
        assert ([coefficients[inside].min(axis=0), coefficients[inside].max(axis=0)] == box.T).all()
    places = np.arange(tree.leaf_boxes.shape[0] * LANES)
    empty = tree.leaf_boxes[places // LANES, :, :, places % LANES][len(leaves) :]
    assert np.isinf(empty).all()


def test_the_table_of_phi_branches_as_phi():
    """The uniforms are nearer to Φ than the table is exact, and beyond its ends."""
    rng = np.random.default_rng(9)
    probes = rng.uniform(-8.0, 8.0, size=(4000, 1))
    uniforms = (norm.cdf(probes[:, 0]) + rng.choice([-1e-3, -1e-5, -1e-9, 1e-9, 1e-5, 1e-3], 4000)).clip(
        0.0, 1.0 - 1e-16
    )
    two = sign_tree(np.array([[-1.0], [1.0]], dtype=np.float32))
    right = draw(two, probes, 1.0, np.stack([uniforms, uniforms], axis=1), "uniform")
    assert (right == (uniforms < norm.cdf(probes[:, 0]))).all()


@pytest.mark.parametrize("beta", [0.05, 1.0])
def test_many_draws_from_one_search_have_the_exact_probabilities(beta):
    coefficients, rng = database(), np.random.default_rng(1)
    probes = coefficients[[7, 100]] + 0.3 * rng.normal(size=(2, 8))
    result = search(
        kd_tree(coefficients), probes, np.array([20000, 10000]), beta, rng.random(30000), tail_probability=1e-6
    )
    for probe, entries, log_mass in zip(probes, np.split(result.entries, [20000]), result.log_mass, strict=True):
        assert goodness_of_fit(entries, np.exp(exact_log_prob(coefficients, probe, beta))) > 1e-4
        squares = ((coefficients - probe) ** 2).sum(axis=1)
        assert log_mass == pytest.approx(np.log(np.exp(-squares / (2 * beta)).sum()), abs=1e-4)


def test_draws_do_not_depend_on_how_probes_share_a_search():
    """One search with three draws gives the entries of three searches with one draw each."""
    coefficients, rng = database(), np.random.default_rng(2)
    tree, probe, uniforms = kd_tree(coefficients), rng.normal(size=(1, 8)), rng.random(3)
    together = search(tree, probe, np.array([3]), 0.2, uniforms).entries
    separate = search(tree, np.repeat(probe, 3, axis=0), np.ones(3, dtype=np.int64), 0.2, uniforms).entries
    assert (together == separate).all()


@pytest.mark.parametrize("beta", [1e-9, 1e-30])
def test_far_probes_at_a_tiny_temperature_find_a_nearest_entry(beta):
    """There float32 does not separate the search radius from the nearest distance."""
    coefficients, rng = database(4000), np.random.default_rng(8)
    probes = 1000.0 * rng.normal(size=(50, 8))
    result = search(kd_tree(coefficients), probes, np.ones(50, dtype=np.int64), beta, rng.random(50))
    squares = ((coefficients[None] - probes[:, None]) ** 2).sum(axis=2)
    assert squares[np.arange(50), result.entries] == pytest.approx(squares.min(axis=1), rel=1e-5)


def test_fidelity_is_the_mean_total_variation():
    coefficients, rng = database(), np.random.default_rng(0)
    probes = coefficients[:5].astype(np.float64)
    result = fidelity(sign_tree(coefficients), coefficients, probes, 0.05, rng)
    tree, exact = sign_tree(coefficients), [np.exp(exact_log_prob(coefficients, probe, 0.05)) for probe in probes]
    expected = [0.5 * np.abs(p - np.exp(log_proposal(tree, c, 0.05))).sum() for p, c in zip(exact, probes, strict=True)]
    assert result.total_variation == pytest.approx(np.mean(expected))
    assert (
        fidelity(kd_tree(coefficients), coefficients, probes, 0.05, rng, tail_probability=1e-6).total_variation < 1e-5
    )


def test_invalid_input_is_rejected():
    coefficients = database()
    tree, probe = kd_tree(coefficients), np.zeros((1, 8))
    one = np.array([1])
    with pytest.raises(InputError, match="beta"):
        search(tree, probe, one, 0.0, np.zeros(1))
    with pytest.raises(InputError, match="tail_probability"):
        search(tree, probe, one, 1.0, np.zeros(1), tail_probability=0.0)
    with pytest.raises(ValueError, match="probes"):
        search(tree, np.full((1, 8), np.nan), one, 1.0, np.zeros(1))
    with pytest.raises(ValueError, match="probes"):
        search(tree, np.full((1, 8), 1e16), one, 1.0, np.zeros(1))
    with pytest.raises(ValueError, match="probes"):
        draw(sign_tree(coefficients), np.full((1, 8), np.nan), 1.0, np.zeros((1, 9)))
    with pytest.raises(ValueError, match="counts"):
        search(tree, probe, np.array([2]), 1.0, np.zeros(1))
    with pytest.raises(InputError, match="leaf"):
        draw(sign_tree(coefficients), probe, 1.0, np.zeros((1, 9)), "nearest")
    with pytest.raises(InputError, match="coefficients"):
        kd_tree(np.empty((0, 3), dtype=np.float32))
