"""The solver of banded matrices with a border against dense linear algebra."""

from types import SimpleNamespace

import numpy as np
import pytest

from workbench.inference.least_squares.solver.sparse_solver import Pattern


def random_system(n_band, n_border, width, seed):
    """Return a positive definite matrix of the pattern, the same matrix dense, and the generator."""
    rng = np.random.default_rng(seed)
    pattern = Pattern(n_band, n_border, width)
    n = n_band + n_border
    i, j = np.tril_indices(n)
    in_pattern = (i >= n_band) | (i - j <= width)
    i, j = i[in_pattern], j[in_pattern]
    values = rng.standard_normal(len(i)) + np.where(i == j, 4.0 * n, 0.0)
    dense = np.zeros((n, n))
    dense[i, j] = dense[j, i] = values
    return pattern.assemble(pattern.flat_index(i, j), values), dense, rng


PATTERNS = [(12, 0, 3), (12, 0, 11), (20, 5, 6), (9, 2, 0), (1, 3, 0)]


@pytest.mark.parametrize(("n_band", "n_border", "width"), PATTERNS)
def test_the_solution_equals_that_of_the_dense_system(n_band, n_border, width):
    matrix, dense, rng = random_system(n_band, n_border, width, 0)
    right, damping = rng.standard_normal(len(dense)), rng.random(len(dense))
    np.testing.assert_array_equal(matrix.dense(), dense)
    expected = np.linalg.solve(dense + np.diag(damping), right)
    np.testing.assert_allclose(matrix.factor(damping).solve(right), expected, rtol=1e-10, atol=1e-14)


@pytest.mark.parametrize(("n_band", "n_border", "width"), PATTERNS)
def test_covariances_are_blocks_of_the_dense_inverse(n_band, n_border, width):
    matrix, dense, _ = random_system(n_band, n_border, width, 1)
    inverse = np.linalg.inv(dense)
    size = min(width + 1, n_band)
    columns = np.array(
        [[*range(n_band, n_band + n_border), *range(t, t + size)] for t in range(n_band - size + 1)], dtype=np.int64
    )
    blocks = matrix.factor().covariances(columns)
    for block, indices in zip(blocks, columns, strict=True):
        np.testing.assert_allclose(block, inverse[np.ix_(indices, indices)], rtol=1e-9, atol=1e-15)


@pytest.mark.parametrize(("n_band", "n_border", "width"), PATTERNS)
def test_samples_have_the_covariance_of_the_dense_inverse(n_band, n_border, width):
    """Samples of unit vectors are the columns of a root of the covariance."""
    matrix, dense, _ = random_system(n_band, n_border, width, 2)
    unit_vectors = SimpleNamespace(standard_normal=lambda shape: np.eye(*shape))
    root = matrix.factor().sample(n_band + n_border, unit_vectors)
    np.testing.assert_allclose(root @ root.T, np.linalg.inv(dense), rtol=1e-9, atol=1e-15)


def test_repeated_entries_are_added_and_the_upper_triangle_is_ignored():
    pattern = Pattern(3, 1, 1)
    i, j = np.indices((2, 2)) + 1
    values = np.array([[2.0, 0.5], [0.5, 3.0]])
    matrix = pattern.assemble(np.stack([pattern.flat_index(i, j)] * 2), np.stack([values] * 2)).dense()
    np.testing.assert_array_equal(matrix[1:3, 1:3], 2.0 * values)
    assert matrix.sum() == 2.0 * values.sum()


@pytest.mark.parametrize("index", [1, 5], ids=["band", "border"])
def test_an_indefinite_matrix_is_rejected(index):
    pattern, diagonal, values = Pattern(4, 2, 1), np.arange(6), np.ones(6)
    values[index] = -1.0
    with pytest.raises(np.linalg.LinAlgError):
        pattern.assemble(pattern.flat_index(diagonal, diagonal), values).factor()
