"""Levenberg–Marquardt over sparse normal equations, whose matrix is a band with a dense border: an arrowhead.

Unknowns that belong to one frame meet only those of nearby frames: the band. Unknowns that all frames share, such as
a style that stays the same, meet every other one: the border, eliminated by a Schur complement.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import scipy

from workbench.utils.arrays import FloatArray, IntArray

FIRST_DAMPING = 1e-3
LARGEST_DAMPING = 1e12


@dataclass(frozen=True)
class Pattern:
    """The pattern of a symmetric (n, n) matrix, n = n_band + n_border, and the place of each entry in its storage.

    n_band: the first unknowns, which meet each other only up to `width` apart. n_border: the last ones, which meet
    all. The lower triangle is kept, in (width + 1 + n_border, n) cells: [i − j, j] of the band, then the border's rows.
    """

    n_band: int
    n_border: int
    width: int

    @property
    def shape(self) -> tuple[int, int]:
        """Return rows and columns of the storage."""
        return self.width + 1 + self.n_border, self.n_band + self.n_border

    def place(self, rows: IntArray, columns: IntArray) -> IntArray:
        """Return flat cells of entries (rows, columns), equal shapes; above the diagonal, one past the last cell."""
        n_rows, n_columns = self.shape
        row = np.where(rows < self.n_band, rows - columns, self.width + 1 + rows - self.n_band)
        return np.where(rows >= columns, row * n_columns + columns, n_rows * n_columns)

    def fill(self, places: IntArray, values: FloatArray) -> "Arrowhead":
        """Return the matrix whose entries are the sums of the values (...) at their `places` (...)."""
        n_rows, n_columns = self.shape
        cells = np.bincount(places.ravel(), values.ravel(), minlength=n_rows * n_columns + 1)[:-1]
        return Arrowhead(self, np.asarray(cells, dtype=np.float64).reshape(n_rows, n_columns))


@dataclass(frozen=True, eq=False)
class Arrowhead:
    """A symmetric matrix of the pattern `pattern`. cells: its lower triangle as stored there."""

    pattern: Pattern
    cells: FloatArray

    def dense(self) -> FloatArray:
        """Return the whole matrix (n, n)."""
        n = self.pattern.shape[1]
        rows, columns = np.tril_indices(n)
        kept = (rows >= self.pattern.n_band) | (rows - columns <= self.pattern.width)
        matrix = np.zeros((n, n))
        matrix[rows[kept], columns[kept]] = self.cells.ravel()[self.pattern.place(rows[kept], columns[kept])]
        return matrix + np.tril(matrix, -1).T

    def factor(self, damping: FloatArray | float = 0.0) -> "Factor":
        """Return the factors of the matrix with `damping` (n,) added to its diagonal. Raises numpy.linalg.LinAlgError
        when that is not positive definite."""
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
        """Return x (n,) of A x = right (n,), or several as columns (n, k)."""
        n_band = self.pattern.n_band
        x: FloatArray = scipy.linalg.cho_solve_banded((self.root, True), right[:n_band], check_finite=False)
        if not self.pattern.n_border:
            return x
        shared = scipy.linalg.cho_solve(
            (self.corner, True), right[n_band:] - self.reduced.T @ right[:n_band], check_finite=False
        )
        return np.concatenate([x - self.reduced @ shared, shared])

    def covariances(self, columns: IntArray) -> FloatArray:
        """Return the blocks (T, D, D) of A⁻¹ that belong to the unknowns `columns` (T, D) of each of T frames. Unknowns
        of one frame must meet in the pattern."""
        n_band, width = self.pattern.n_band, self.pattern.width
        near = _selected_inverse(self.root)
        banded = columns < n_band
        i, j = columns[:, :, None], columns[:, None, :]
        both = banded[:, :, None] & banded[:, None, :]
        apart, first = np.abs(i - j).clip(max=width), np.minimum(i, j).clip(max=n_band - 1)
        blocks: FloatArray = np.where(both, near[apart, first], 0.0)
        if not self.pattern.n_border:
            return blocks
        # [x, shared] has the covariance [B⁻¹ + V S⁻¹ Vᵀ, −V S⁻¹; −S⁻¹ Vᵀ, S⁻¹] with V = B⁻¹Cᵀ
        shared = scipy.linalg.cho_solve((self.corner, True), np.eye(self.pattern.n_border))
        spread = np.concatenate([-self.reduced, np.eye(self.pattern.n_border)])[columns]
        blocks += spread @ shared @ spread.transpose(0, 2, 1)
        return blocks


def _selected_inverse(root: FloatArray) -> FloatArray:
    """Return the band (w + 1, n) of A⁻¹ from A's banded Cholesky factor `root` (w + 1, n), both as lower diagonals.

    Block of w + 1 columns by block from the last one, without the rest of the inverse (Takahashi, Fagan & Chen 1973):
    with L the factor's block on the diagonal, M the one below, and Z the inverse's block beyond it, the inverse has
    −Z G below and L⁻ᵀ L⁻¹ + Gᵀ Z G on the diagonal, G = M L⁻¹. For a band that is one chain of frames this is the
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
        beside = -beyond @ gain
        block = np.concatenate([inverted.T @ inverted - gain.T @ beside, beside])
        inverse[:, first:end] = block[rows, columns]
        beyond = np.block([[block[: len(columns)], beside.T], [beside, beyond]])[:width, :width]
    return inverse


@dataclass(frozen=True, eq=False)
class Quadratic:
    """The Gauss–Newton model of a cost around a point: cost + gradient·δ + ½ δᵀ normal δ. gradient: (n,).

    trust: (n,) the diagonal of that part of `normal` which is an approximation; terms that are quadratic need no
    damping, which would only slow down what they tie together.
    """

    cost: float
    gradient: FloatArray
    normal: Arrowhead
    trust: FloatArray


@dataclass(frozen=True, eq=False)
class Minimum:
    """Where the search ended. x: (n,). quadratic: the model there. costs: at the start and after every accepted step,
    never rising. iterations: steps tried, each one evaluation."""

    x: FloatArray
    quadratic: Quadratic
    costs: tuple[float, ...]
    iterations: int


def minimise(
    expand: Callable[[FloatArray], Quadratic], x: FloatArray, *, max_iterations: int = 40, tolerance: float = 1e-4,
    least_gain: float = 0.0, progress: Callable[[float], None] = lambda cost: None,
) -> Minimum:  # fmt: skip
    """Minimise a sum of squares from x (n,).

    expand: the cost and its quadratic model at a point; one call per iteration, as nearly all steps are accepted. The
    damping is relative to `Quadratic.trust` and follows the gain (Madsen, Nielsen & Tingleff 2004, algorithm 3.16). It
    ends when the model promises to lower the cost by less than `tolerance` of it, or by less than `least_gain`.
    progress: called with every cost.
    """
    here = expand(x)
    costs, damping, growth, iterations = [here.cost], FIRST_DAMPING, 2.0, 0
    while iterations < max_iterations and damping < LARGEST_DAMPING and here.gradient.any():
        scale = damping * np.maximum(here.trust, 1e-9 * here.trust.max())
        try:
            step = -here.normal.factor(scale).solve(here.gradient)
        except np.linalg.LinAlgError:  # not positive definite to rounding: more damping makes it so
            damping, growth = damping * growth, 2.0 * growth
            continue
        promised = 0.5 * float(step @ (scale * step - here.gradient))
        if promised <= max(tolerance * here.cost, least_gain):
            break
        there = expand(x + step)
        iterations += 1
        gain = (here.cost - there.cost) / promised
        if gain > 0.0:
            x, here = x + step, there
            costs.append(here.cost)
            damping, growth = damping * max(1.0 / 3.0, 1.0 - (2.0 * gain - 1.0) ** 3), 2.0
        else:
            damping, growth = damping * growth, 2.0 * growth
        progress(here.cost)
    return Minimum(x, here, tuple(costs), iterations)
