"""Least squares over all frames at once: roots, phases and the style of a motion model (paper D, sections 4.2, 4.3)."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import TypeAlias

import numpy as np
import scipy
from tqdm import tqdm

from workbench.body.skeleton import N_ROOT
from workbench.core.losses import Loss
from workbench.core.prior import REFERENCE_RATE_HZ
from workbench.core.residual import ResidualFunction
from workbench.inference.least_squares.motion.motion_decoder import MotionDecoder
from workbench.inference.least_squares.motion.shared_errors import SharedErrors
from workbench.inference.least_squares.solver.single_frame import Decoder, FitData
from workbench.inference.least_squares.solver.sparse_solver import Minimum, Pattern, Quadratic, minimise
from workbench.utils.arrays import FloatArray, IntArray
from workbench.utils.errors import InputError

FLAT_STD = 1.0
"""Standard deviation, m, rad, cycles or of a coefficient, of unknowns without observations or regularisation."""
N_LOCAL = 1 + N_ROOT
"""Unknowns of each single frame: phase and root."""
Row: TypeAlias = tuple[IntArray, FloatArray]
"""Columns and values of one row of R."""


@dataclass(frozen=True, eq=False)
class FitProblem:
    """F = Σ_t Σ_k ρ(r_tk) + ½ |R x|² over unknowns x (n,): paper D, eq. 11, plus a regularisation R.

    residuals: one function per frame. columns: (T, D) indices of the unknowns in each frame's state {α, μ, root};
    frames of one style share those of α. penalty: (m, n) R. pattern: sparsity of the normal equations. Flat
    indices in the pattern: `frame_indices` (T, D, D) of the frames' blocks, and `penalty_indices` of `penalty_entries`,
    those of RᵀR.
    """

    decoder: Decoder
    residuals: Sequence[ResidualFunction]
    loss: Loss
    columns: IntArray
    penalty: "scipy.sparse.csr_array"
    pattern: Pattern
    frame_indices: IntArray
    penalty_indices: IntArray
    penalty_entries: FloatArray

    @staticmethod
    def of(
        decoder: Decoder, data: FitData, columns: IntArray, rows: Sequence[Row], n_border: int
    ) -> "FitProblem":  # fmt: skip
        """Return the problem with the penalty of `rows`; the last n_border unknowns are shared by all frames."""
        n = int(columns.max()) + 1
        row_indices = np.concatenate([np.empty(0, int), *(np.full(len(at), k) for k, (at, _) in enumerate(rows))])
        at = np.concatenate([np.empty(0, int), *(row[0] for row in rows)])
        values = np.concatenate([np.empty(0), *(row[1] for row in rows)])
        penalty = scipy.sparse.csr_array((values, (row_indices, at)), shape=(len(rows), n))
        square = (penalty.T @ penalty).tocoo()
        i, j = np.broadcast_arrays(columns[:, :, None], columns[:, None, :])
        all_rows = np.concatenate([i.ravel(), square.row])
        all_columns = np.concatenate([j.ravel(), square.col])
        banded = (all_rows < n - n_border) & (all_columns < n - n_border)
        pattern = Pattern(n - n_border, n_border, int(np.abs(all_rows - all_columns)[banded].max()))
        return FitProblem(
            decoder, data.residuals, data.loss, columns, penalty, pattern,
            pattern.flat_index(i, j), pattern.flat_index(square.row, square.col), square.data,
        )  # fmt: skip

    def unknowns(self, states: FloatArray) -> FloatArray:
        """Return the unknowns x (n,) of states (T, D); a shared style is the frames' mean."""
        return np.bincount(self.columns.ravel(), states.ravel()) / np.bincount(self.columns.ravel())

    def expand(self, x: FloatArray) -> Quadratic:
        """Return the cost at x (n,) and its Gauss–Newton model with the loss's weights (iteratively reweighted)."""
        states = x[self.columns]
        poses, decoding = self.decoder.poses(states), self.decoder.jacobian(states)
        gradients, blocks, cost = np.empty(states.shape), np.empty(self.frame_indices.shape), 0.0
        for t, residual in enumerate(self.residuals):
            residuals, jacobian = residual(poses[t])
            rho, weights = self.loss(residuals)
            jacobian, size = jacobian @ decoding[t], np.sqrt(weights)
            jacobian *= size[:, None]
            # the product of a matrix with its own transpose takes half the work
            gradients[t], blocks[t] = jacobian.T @ (size * residuals), jacobian.T @ jacobian
            cost += float(rho.sum())
        penalty_values = self.penalty @ x
        gradient = np.bincount(self.columns.ravel(), gradients.ravel()) + self.penalty.T @ penalty_values
        cells = np.concatenate([self.frame_indices.ravel(), self.penalty_indices])
        normal = self.pattern.assemble(cells, np.concatenate([blocks.ravel(), self.penalty_entries]))
        diagonals = np.diagonal(blocks, axis1=1, axis2=2).ravel()
        damping_diagonal = np.asarray(np.bincount(self.columns.ravel(), diagonals), dtype=np.float64)
        cost += 0.5 * float(penalty_values @ penalty_values)
        return Quadratic(cost, gradient, normal, damping_diagonal)


def fit_problem(decoder: MotionDecoder, data: FitData, frames_per_style: int, plain: bool = False) -> FitProblem:
    """Return the problem of T frames with coefficients α for every `frames_per_style` of them.

    One style for all frames is D's steady style (eq. 12), one per frame its varying style (eq. 15).

    Regularisation: α is a stationary first-order autoregression with N(0, 1) marginals, in units of the model's scales;
    smoothness.style is the standard deviation of its innovation, and 0 gives the steady style. Second differences of μ
    and of the root are normal. D has no regularisation (section 5), nor has a `plain` problem.

    Raises InputError unless the times increase.
    """
    if np.any(np.diff(data.times_s) <= 0.0):
        raise InputError("least squares: expected the times of the frames to increase")
    times, styles = REFERENCE_RATE_HZ * data.times_s, np.arange(len(data.times_s)) // frames_per_style
    columns, n_border = _columns(styles, decoder.n_style)
    if plain:
        return FitProblem.of(decoder, data, columns, (), n_border)
    rows = _style_rows(styles, columns[:, : decoder.n_style], times, data.smoothness.style)
    rows += second_differences(columns[:, decoder.n_style :], times, data.smoothness.second_differences)
    return FitProblem.of(decoder, data, columns, rows, n_border)


def fit_motion(
    problem: FitProblem, states: FloatArray, *, max_iterations: int = 40, tolerance: float = 1e-4
) -> tuple[FloatArray, FloatArray, Minimum]:
    """Return fitted states (T, D), searched from `states`, their marginal covariances (T, D, D), and the search.

    The covariance is the inverse of the Gauss–Newton matrix at the minimum (Laplace approximation). Without
    regularisation every unknown has a prior standard deviation of FLAT_STD in it. Raises InputError when observations
    and regularisation leave an unknown undetermined.
    """
    with tqdm(total=max_iterations, desc="least squares", unit="step", disable=None, leave=False) as bar:

        def progress(cost: float) -> None:
            bar.set_postfix_str(f"cost {cost:.4g}")
            bar.update()

        start = problem.unknowns(states)
        search = minimise(problem.expand, start, max_iterations=max_iterations, tolerance=tolerance, progress=progress)
    try:
        flat = 0.0 if problem.penalty.shape[0] else FLAT_STD**-2
        covariances = search.quadratic.normal.factor(flat).covariances(problem.columns)
    except np.linalg.LinAlgError:
        raise InputError(
            f"least squares: the observations of {len(states)} frames do not determine the motion; expected more points"
        ) from None
    return search.x[problem.columns], covariances, search


def discrepancy_sensitivity(problem: FitProblem, search: Minimum, discrepancy_root: FloatArray) -> FloatArray:
    """Return the first-order change (T, D, k) of the fitted states for k constant pose errors of the model.

    It is H⁻¹ Σ_t (∂r_t/∂x)ᵀ W_t (∂r_t/∂pose) A with the errors A (P, k), `discrepancy_root`, and the Gauss–Newton
    matrix H.
    """
    return _state_sensitivity(problem, search, lambda t, jacobian, pose: jacobian @ discrepancy_root)


def bias_sensitivity(problem: FitProblem, search: Minimum, shared: SharedErrors) -> FloatArray:
    """Return the error (T, D, k) of the fitted states for one standard deviation of each of k shared errors of the
    observations: H⁻¹ Σ_t (∂r_t/∂x)ᵀ W_t changes_t, as in `discrepancy_sensitivity`, up to the sign."""
    return _state_sensitivity(problem, search, lambda t, jacobian, pose: shared.residual_changes(t, jacobian, pose))


def _state_sensitivity(
    problem: FitProblem, search: Minimum, changes: Callable[[int, FloatArray, FloatArray], FloatArray]
) -> FloatArray:
    """Return the change (T, D, k) of the states for changes (K, k) of each frame's residuals."""
    states = search.x[problem.columns]
    poses, decoding = problem.decoder.poses(states), problem.decoder.jacobian(states)
    right = np.zeros(0)
    for t, residual in enumerate(problem.residuals):
        residuals, jacobian = residual(poses[t])
        weighted = problem.loss(residuals)[1][:, None] * changes(t, jacobian, poses[t])
        right = right if right.size else np.zeros((len(search.x), weighted.shape[1]))
        right[problem.columns[t]] += decoding[t].T @ (jacobian.T @ weighted)
    factor = search.quadratic.normal.factor()
    return factor.solve(right)[problem.columns]


def _columns(styles: IntArray, n_style: int) -> tuple[IntArray, int]:
    """Return the indices of the unknowns (T, D) of each frame, and the size of the border. A single style is the
    border; several are placed before their frames, so that the band stays narrow."""
    n_frames, n_styles = len(styles), int(styles[-1]) + 1
    local = N_LOCAL * np.arange(n_frames)[:, None] + np.arange(N_LOCAL)
    if n_styles == 1:
        shared = np.broadcast_to(N_LOCAL * n_frames + np.arange(n_style), (n_frames, n_style))
        return np.hstack([shared, local]), n_style
    first = np.searchsorted(styles, np.arange(n_styles))  # the first frame of every style
    alpha = (n_style * np.arange(n_styles) + N_LOCAL * first)[:, None] + np.arange(n_style)
    return np.hstack([alpha[styles], local + n_style * (styles + 1)[:, None]]), 0


def _style_rows(styles: IntArray, columns: IntArray, times: FloatArray, innovation: float) -> list[Row]:
    """Return the penalty rows of the autoregression of the styles. columns: (T, d). times: (T,) in frames at
    REFERENCE_RATE_HZ. innovation: its standard deviation per frame."""
    first = np.searchsorted(styles, np.arange(styles[-1] + 1))
    rows = [(columns[0, k : k + 1], np.ones(1)) for k in range(columns.shape[1])]
    for before, after in pairwise(first):
        correlation = max(0.0, 1.0 - innovation**2) ** (0.5 * (times[after] - times[before]))
        deviation = np.sqrt(1.0 - correlation**2)
        pairs = np.stack([columns[before], columns[after]], axis=1)
        rows += [(pair, np.array([-correlation, 1.0]) / deviation) for pair in pairs]
    return rows


def second_differences(columns: IntArray, times: FloatArray, deviations: FloatArray) -> list[Row]:
    """Return the penalty rows of second differences of columns (T, m) with standard deviations (m,). times: (T,) in
    frames at REFERENCE_RATE_HZ; at uneven times the speed is a random walk between the midpoints."""
    rows = []
    for t in range(1, len(columns) - 1):
        before, after = 1.0 / np.diff(times[t - 1 : t + 2])
        walked = np.sqrt(0.5 * (times[t + 1] - times[t - 1]))
        values = np.array([before, -before - after, after]) / walked
        rows += [(columns[t - 1 : t + 2, k], values / deviation) for k, deviation in enumerate(deviations)]
    return rows
