"""The banded solver with a border against dense linear algebra."""

import numpy as np
import pytest

from workbench.inference.least_squares.solver import Pattern


def random_system(n_band, n_border, width, seed):
    """A positive definite matrix of the pattern, and the same dense."""
    rng = np.random.default_rng(seed)
    pattern = Pattern(n_band, n_border, width)
    n = n_band + n_border
    i, j = np.tril_indices(n)
    kept = (i >= n_band) | (i - j <= width)
    i, j = i[kept], j[kept]
    values = rng.standard_normal(len(i)) + np.where(i == j, 4.0 * n, 0.0)
    dense = np.zeros((n, n))
    dense[i, j] = dense[j, i] = values
    return pattern.assemble(pattern.flat_index(i, j), values), dense, rng


PATTERNS = [(12, 0, 3), (12, 0, 11), (20, 5, 6), (9, 2, 0), (1, 3, 0)]


@pytest.mark.parametrize(("n_band", "n_border", "width"), PATTERNS)
def test_solves_as_the_dense_system_does(n_band, n_border, width):
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
    for block, own in zip(blocks, columns, strict=True):
        np.testing.assert_allclose(block, inverse[np.ix_(own, own)], rtol=1e-9, atol=1e-15)


def test_entries_given_twice_add_and_the_upper_triangle_is_not_counted():
    pattern = Pattern(3, 1, 1)
    i, j = np.indices((2, 2)) + 1
    values = np.array([[2.0, 0.5], [0.5, 3.0]])
    matrix = pattern.assemble(np.stack([pattern.flat_index(i, j)] * 2), np.stack([values] * 2)).dense()
    np.testing.assert_array_equal(matrix[1:3, 1:3], 2.0 * values)
    assert matrix.sum() == 2.0 * values.sum()


def test_a_matrix_that_is_not_positive_definite_is_an_error():
    pattern = Pattern(4, 2, 1)
    diagonal = np.arange(6)
    for wrong in (1, 5):
        values = np.ones(6)
        values[wrong] = -1.0
        with pytest.raises(np.linalg.LinAlgError):
            pattern.assemble(pattern.flat_index(diagonal, diagonal), values).factor()
