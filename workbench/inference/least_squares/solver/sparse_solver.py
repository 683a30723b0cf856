"""Levenberg–Marquardt over sparse normal equations with an arrowhead matrix: a band with a dense border.

Unknowns of one frame are coupled only with those of nearby frames: the band. Unknowns shared by all frames, such as a
constant style, are coupled with all others: the border, eliminated by a Schur complement.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import scipy
from scipy.linalg.lapack import dtbtrs

from workbench.utils.arrays import FloatArray, IntArray

FIRST_DAMPING = 1e-3
MAX_DAMPING = 1e12


@dataclass(frozen=True)
class Pattern:
    """Sparsity pattern of a symmetric (n, n) matrix, n = n_band + n_border, and the storage of its entries.

    n_band: the first unknowns, coupled with each other up to index distance `width`. n_border: the last ones, coupled
    with all. The lower triangle is stored in (width + 1 + n_border, n) cells: [i − j, j] of the band, then the border's
    rows.
    """

    n_band: int
    n_border: int
    width: int

    @property
    def shape(self) -> tuple[int, int]:
        """Return the shape of the storage."""
        return self.width + 1 + self.n_border, self.n_band + self.n_border

    def flat_index(self, rows: IntArray, columns: IntArray) -> IntArray:
        """Return the flat indices of entries (rows, columns) of equal shape; one past the last cell above the
        diagonal."""
        n_rows, n_columns = self.shape
        row = np.where(rows < self.n_band, rows - columns, self.width + 1 + rows - self.n_band)
        return np.where(rows >= columns, row * n_columns + columns, n_rows * n_columns)

    def assemble(self, indices: IntArray, values: FloatArray) -> "Arrowhead":
        """Return the matrix whose entries are the sums of `values` (...) at their flat `indices` (...)."""
        n_rows, n_columns = self.shape
        cells = np.bincount(indices.ravel(), values.ravel(), minlength=n_rows * n_columns + 1)[:-1]
        return Arrowhead(self, np.asarray(cells, dtype=np.float64).reshape(n_rows, n_columns))


@dataclass(frozen=True, eq=False)
class Arrowhead:
    """A symmetric matrix. cells: its lower triangle, stored as in `pattern`."""

    pattern: Pattern
    cells: FloatArray

    def dense(self) -> FloatArray:
        """Return the dense matrix (n, n)."""
        n = self.pattern.shape[1]
        rows, columns = np.tril_indices(n)
        stored = (rows >= self.pattern.n_band) | (rows - columns <= self.pattern.width)
        matrix = np.zeros((n, n))
        matrix[rows[stored], columns[stored]] = self.cells.ravel()[
            self.pattern.flat_index(rows[stored], columns[stored])
        ]
        return matrix + np.tril(matrix, -1).T

    def factor(self, damping: FloatArray | float = 0.0) -> "Factor":
        """Return the Cholesky factors of the matrix plus diag(`damping` (n,)). Raises numpy.linalg.LinAlgError unless
        it is positive definite."""
        n_band, width = self.pattern.n_band, self.pattern.width
        added = np.broadcast_to(damping, self.pattern.shape[1:])
        band = self.cells[: width + 1, :n_band].copy(order="K")
        band[0] += added[:n_band]
        root = scipy.linalg.cholesky_banded(band, overwrite_ab=True, lower=True, check_finite=False)
        border = self.cells[width + 1 :, :n_band]
        if not self.pattern.n_border:
            return Factor(self.pattern, root, border.T, border)
        reduced = scipy.linalg.cho_solve_banded((root, True), border.T, check_finite=False)
        schur = self.cells[width + 1 :, n_band:] + np.diag(added[n_band:]) - border @ reduced
        corner = np.tril(scipy.linalg.cho_factor(schur, lower=True, check_finite=False)[0])
        return Factor(self.pattern, root, reduced, corner)


@dataclass(frozen=True, eq=False)
class Factor:
    """Cholesky factors. root: (width + 1, n_band) of the band B. reduced: (n_band, n_border) B⁻¹Cᵀ of the border C.
    corner: (n_border, n_border) of the Schur complement D − C B⁻¹ Cᵀ, lower triangular."""

    pattern: Pattern
    root: FloatArray
    reduced: FloatArray
    corner: FloatArray

    def solve(self, right: FloatArray) -> FloatArray:
        """Return the solution x of A x = right, (n,) or several columns (n, k)."""
        n_band = self.pattern.n_band
        x: FloatArray = scipy.linalg.cho_solve_banded((self.root, True), right[:n_band], check_finite=False)
        if not self.pattern.n_border:
            return x
        shared = scipy.linalg.cho_solve(
            (self.corner, True), right[n_band:] - self.reduced.T @ right[:n_band], check_finite=False
        )
        return np.concatenate([x - self.reduced @ shared, shared])

    def sample(self, n: int, rng: np.random.Generator) -> FloatArray:
        """Return n samples (N, n) of N unknowns from the Gaussian of covariance A⁻¹, L⁻ᵀ z with the factor L of A."""
        n_band, size = self.pattern.n_band, self.pattern.shape[1]
        white = rng.standard_normal((n, size)).T  # in Fortran order, as LAPACK takes it
        x: FloatArray = dtbtrs(self.root, white[:n_band], uplo="L", trans="T")[0]
        if not self.pattern.n_border:
            return x
        shared = scipy.linalg.solve_triangular(self.corner, white[n_band:], trans="T", lower=True, check_finite=False)
        return np.concatenate([x - self.reduced @ shared, shared])

    def covariances(self, columns: IntArray) -> FloatArray:
        """Return the blocks (T, D, D) of A⁻¹ of the unknowns `columns` (T, D) of each frame. Unknowns of one frame must
        be coupled in the pattern."""
        n_band, width = self.pattern.n_band, self.pattern.width
        inverse_band = _selected_inverse(self.root)
        banded = columns < n_band
        i, j = columns[:, :, None], columns[:, None, :]
        both_banded = banded[:, :, None] & banded[:, None, :]
        distance, first = np.abs(i - j).clip(max=width), np.minimum(i, j).clip(max=n_band - 1)
        blocks: FloatArray = np.where(both_banded, inverse_band[distance, first], 0.0)
        if not self.pattern.n_border:
            return blocks
        # [x, shared] has the covariance [B⁻¹ + V S⁻¹ Vᵀ, −V S⁻¹; −S⁻¹ Vᵀ, S⁻¹] with V = B⁻¹Cᵀ
        shared = scipy.linalg.cho_solve((self.corner, True), np.eye(self.pattern.n_border))
        sensitivity = np.concatenate([-self.reduced, np.eye(self.pattern.n_border)])[columns]
        blocks += sensitivity @ shared @ sensitivity.transpose(0, 2, 1)
        return blocks


def _selected_inverse(root: FloatArray) -> FloatArray:
    """Return the band (w + 1, n) of A⁻¹ from A's banded Cholesky factor `root` (w + 1, n), both as lower diagonals.

    The recursion runs backwards over blocks of w + 1 columns without the rest of the inverse (Takahashi, Fagan & Chen
    1973). Let L be the factor's diagonal block, M the one below, Z the inverse's block beyond it and G = M L⁻¹; then
    the inverse has −Z G below and L⁻ᵀ L⁻¹ + Gᵀ Z G on the diagonal. For a chain of frames this is the
    Rauch–Tung–Striebel smoother.
    """
    width, n = root.shape[0] - 1, root.shape[1]
    inverse, beyond = np.empty_like(root), np.zeros((width, width))
    for end in range(n, 0, -(width + 1)):
        first = max(end - width - 1, 0)
        columns = np.arange(end - first)
        rows = columns + np.arange(width + 1)[:, None]  # of the diagonals' entries
        factor = np.zeros((len(columns) + width, len(columns)))
        factor[rows, columns] = root[:, first:end]
        factor[n - first :] = 0.0
        inverted = scipy.linalg.solve_triangular(
            factor[: len(columns)], np.eye(len(columns)), lower=True, check_finite=False
        )
        gain = factor[len(columns) :] @ inverted
        below = -beyond @ gain
        block = np.concatenate([inverted.T @ inverted - gain.T @ below, below])
        inverse[:, first:end] = block[rows, columns]
        beyond = np.block([[block[: len(columns)], below.T], [below, beyond]])[:width, :width]
    return inverse


@dataclass(frozen=True, eq=False)
class Quadratic:
    """The Gauss–Newton model of a cost around a point: cost + gradient·δ + ½ δᵀ normal δ. gradient: (n,).

    damping_diagonal: (n,) diagonal of the part of `normal` that is an approximation. Quadratic terms need no damping,
    which would only slow convergence.
    """

    cost: float
    gradient: FloatArray
    normal: Arrowhead
    damping_diagonal: FloatArray


@dataclass(frozen=True, eq=False)
class Minimum:
    """Result of a search. x: (n,). quadratic: the model at x. costs: initial and after every accepted step, not
    increasing. iterations: steps tried, one evaluation each."""

    x: FloatArray
    quadratic: Quadratic
    costs: tuple[float, ...]
    iterations: int


def minimise(
    expand: Callable[[FloatArray], Quadratic], x: FloatArray, *, max_iterations: int = 40, tolerance: float = 1e-4,
    min_gain: float = 0.0, progress: Callable[[float], None] = lambda cost: None,
) -> Minimum:  # fmt: skip
    """Return the minimum of a sum of squares, searched from x (n,).

    The damping is relative to `Quadratic.damping_diagonal` and follows the gain ratio (Madsen, Nielsen & Tingleff 2004,
    algorithm 3.16).

    Parameters
    ----------
    expand : returns the cost and its quadratic model at a point; one call per iteration, as most steps are accepted.
    tolerance, min_gain : the search ends when the predicted decrease is below `tolerance` · cost or `min_gain`.
    progress : called with every cost.
    """
    current = expand(x)
    costs, damping, growth, iterations = [current.cost], FIRST_DAMPING, 2.0, 0
    while iterations < max_iterations and damping < MAX_DAMPING and current.gradient.any():
        scale = damping * np.maximum(current.damping_diagonal, 1e-9 * current.damping_diagonal.max())
        try:
            step = -current.normal.factor(scale).solve(current.gradient)
        except np.linalg.LinAlgError:  # not positive definite to rounding: more damping makes it so
            damping, growth = damping * growth, 2.0 * growth
            continue
        predicted_decrease = 0.5 * float(step @ (scale * step - current.gradient))
        if predicted_decrease <= max(tolerance * current.cost, min_gain):
            break
        candidate = expand(x + step)
        iterations += 1
        gain = (current.cost - candidate.cost) / predicted_decrease
        if gain > 0.0:
            x, current = x + step, candidate
            costs.append(current.cost)
            damping, growth = damping * max(1.0 / 3.0, 1.0 - (2.0 * gain - 1.0) ** 3), 2.0
        else:
            damping, growth = damping * growth, 2.0 * growth
        progress(current.cost)
    return Minimum(x, current, tuple(costs), iterations)
