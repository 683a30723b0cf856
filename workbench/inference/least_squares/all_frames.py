"""Least squares over all frames at once: roots, phases and the style of a motion model (paper D, sections 4.2, 4.3)."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import TypeAlias

import numpy as np
import scipy
from tqdm import tqdm

from workbench.body.skeleton import N_ROOT
from workbench.core.prior import REFERENCE_RATE_HZ
from workbench.core.residual import Loss, ResidualFunction
from workbench.inference.least_squares.single_frame import Decoder, FitData, MotionDecoder
from workbench.inference.least_squares.solver import Minimum, Pattern, Quadratic, minimise
from workbench.inference.least_squares.systematic_errors import Shared
from workbench.utils.arrays import FloatArray, IntArray
from workbench.utils.errors import InputError

FLAT = 1.0
"""Standard deviation, m, rad, cycles or of a coefficient, of what neither observations nor regularisation speak of."""
N_LOCAL = 1 + N_ROOT
"""Unknowns that every frame has to itself: phase and root."""
Row: TypeAlias = tuple[IntArray, FloatArray]
"""Columns and values of one row of R."""
Tie: TypeAlias = ResidualFunction
"""Residuals, whitened and made robust, of the poses (2 P,) of one frame and the next, and their derivative (K, 2 P)."""


@dataclass(frozen=True, eq=False)
class FitProblem:
    """F = Σ_t Σ_k ρ(r_tk) + ½ |R x|² + ½ Σ s² over unknowns x (n,) (paper D, eq. 11, with regularisation R and ties s).

    residuals: one function per frame. columns: (T, D) the unknowns that make up the state {α, μ, root} of each frame;
    frames of one style share those of α. penalty: (m, n) R. pattern: where the normal equations are not zero, with
    the cells `frame_cells` (T, D, D) of the frames' blocks and `penalty_cells`, `penalty_entries` those of RᵀR. ties:
    of poses of one frame, whose number comes with them, and the next; `tie_cells` (K, 2 D, 2 D) those of their blocks.
    """

    decoder: Decoder
    residuals: Sequence[ResidualFunction]
    loss: Loss
    columns: IntArray
    penalty: "scipy.sparse.csr_array"
    pattern: Pattern
    frame_cells: IntArray
    penalty_cells: IntArray
    penalty_entries: FloatArray
    ties: Sequence[tuple[int, Tie]]
    tie_cells: IntArray

    @staticmethod
    def of(
        decoder: Decoder, data: FitData, columns: IntArray, rows: Sequence[Row], n_border: int,
        ties: Sequence[tuple[int, Tie]] = (),
    ) -> "FitProblem":  # fmt: skip
        """Pose the problem with the penalty of `rows`; the last n_border unknowns belong to all frames."""
        n = int(columns.max()) + 1
        places = np.concatenate([np.empty(0, int), *(np.full(len(at), k) for k, (at, _) in enumerate(rows))])
        at = np.concatenate([np.empty(0, int), *(row[0] for row in rows)])
        values = np.concatenate([np.empty(0), *(row[1] for row in rows)])
        penalty = scipy.sparse.csr_array((values, (places, at)), shape=(len(rows), n))
        square = (penalty.T @ penalty).tocoo()
        i, j = np.broadcast_arrays(columns[:, :, None], columns[:, None, :])
        first = np.array([t for t, _ in ties], dtype=np.intp)
        tied = np.hstack([columns[first], columns[first + 1]])
        k, m = np.broadcast_arrays(tied[:, :, None], tied[:, None, :])
        every = np.concatenate([i.ravel(), square.row, k.ravel()]), np.concatenate([j.ravel(), square.col, m.ravel()])
        banded = (every[0] < n - n_border) & (every[1] < n - n_border)
        pattern = Pattern(n - n_border, n_border, int(np.abs(every[0] - every[1])[banded].max()))
        return FitProblem(
            decoder, data.residuals, data.loss, columns, penalty, pattern,
            pattern.place(i, j), pattern.place(square.row, square.col), square.data, ties, pattern.place(k, m),
        )  # fmt: skip

    def unknowns(self, states: FloatArray) -> FloatArray:
        """Return x (n,) of states (T, D); a style that frames share is the mean of theirs."""
        return np.bincount(self.columns.ravel(), states.ravel()) / np.bincount(self.columns.ravel())

    def expand(self, x: FloatArray) -> Quadratic:
        """Return the cost at x (n,) and its Gauss–Newton model, with the loss's weights (iteratively reweighted)."""
        states = x[self.columns]
        poses, decoding = self.decoder.poses(states), self.decoder.jacobian(states)
        gradients, blocks, cost = np.empty(states.shape), np.empty(self.frame_cells.shape), 0.0
        for t, residual in enumerate(self.residuals):
            misses, slopes = residual(poses[t])
            rho, weights = self.loss(misses)
            slopes, size = slopes @ decoding[t], np.sqrt(weights)
            slopes *= size[:, None]
            # a matrix's product with itself takes half the work of one with another
            gradients[t], blocks[t] = slopes.T @ (size * misses), slopes.T @ slopes
            cost += float(rho.sum())
        diagonals, tied = np.diagonal(blocks, axis1=1, axis2=2).copy(), np.empty(self.tie_cells.shape)
        for k, (t, tie) in enumerate(self.ties):
            misses, slopes = tie(poses[t : t + 2].ravel())
            slopes = np.hstack([half @ decoding[t + n] for n, half in enumerate(np.hsplit(slopes, 2))])
            tied[k] = slopes.T @ slopes
            gradients[t : t + 2] += (slopes.T @ misses).reshape(2, -1)
            diagonals[t : t + 2] += np.diagonal(tied[k]).reshape(2, -1)
            cost += 0.5 * float(misses @ misses)
        rough = self.penalty @ x
        gradient = np.bincount(self.columns.ravel(), gradients.ravel()) + self.penalty.T @ rough
        cells = np.concatenate([self.frame_cells.ravel(), self.penalty_cells, self.tie_cells.ravel()])
        normal = self.pattern.fill(cells, np.concatenate([blocks.ravel(), self.penalty_entries, tied.ravel()]))
        trust = np.bincount(self.columns.ravel(), diagonals.ravel())
        return Quadratic(cost + 0.5 * float(rough @ rough), gradient, normal, np.asarray(trust, dtype=np.float64))


def fit_problem(decoder: MotionDecoder, data: FitData, frames_per_style: int, plain: bool = False) -> FitProblem:
    """Pose the problem of T frames with coefficients α for every `frames_per_style` of them.

    One for all frames is D's steady style (eq. 12), one for each its varying style (eq. 15).

    Regularisation. α of the first style is N(0, 1) in units of the model's scales, then a stationary autoregression
    whose new part has the deviation smoothness.style, so that a style that may not change is the steady one. Second
    differences of μ and of the root are normal. D has none of this (section 5), nor has a problem that is `plain`.

    Raises InputError for times that do not increase.
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
    """Fit all frames from `states` (T, D); returns states, their marginal covariances (T, D, D), and the search.

    The covariance is the inverse of the Gauss–Newton matrix at the minimum, Laplace's approximation. Without
    regularisation, what the observations leave undetermined has the deviation FLAT in it.
    Raises InputError when observations and regularisation leave some unknown undetermined.
    """
    with tqdm(total=max_iterations, desc="least squares", unit="step", disable=None, leave=False) as bar:

        def progress(cost: float) -> None:
            bar.set_postfix_str(f"cost {cost:.4g}")
            bar.update()

        start = problem.unknowns(states)
        search = minimise(problem.expand, start, max_iterations=max_iterations, tolerance=tolerance, progress=progress)
    try:
        flat = 0.0 if problem.penalty.shape[0] else FLAT**-2
        covariances = search.quadratic.normal.factor(flat).covariances(problem.columns)
    except np.linalg.LinAlgError:
        raise InputError(
            f"least squares: what {len(states)} frames show does not determine the motion; expected more points"
        ) from None
    return search.x[problem.columns], covariances, search


def absorbed(problem: FitProblem, search: Minimum, missed: FloatArray) -> FloatArray:
    """Return how far the states of a fit go, (T, D, k), with k errors of the model `missed` (P, k) that all frames
    share.

    Of a person whose poses are the model's plus one of these, least squares finds, to first order, states that are off
    by H⁻¹ Σ_t (∂r_t/∂x)ᵀ W_t (∂r_t/∂pose) missed, H being the Gauss–Newton matrix.
    """
    return _led(problem, search, lambda t, slopes, pose: slopes @ missed)


def misled(problem: FitProblem, search: Minimum, shared: Shared) -> FloatArray:
    """Return how far the states of a fit are off, (T, D, k), for one deviation of each of k displacements of what is
    seen, or causes of it: by H⁻¹ Σ_t (∂r_t/∂x)ᵀ W_t shifts_t, as in `absorbed`; up to the sign."""
    return _led(problem, search, lambda t, slopes, pose: shared.shifts(t, slopes, pose))


def _led(
    problem: FitProblem, search: Minimum, shifts: Callable[[int, FloatArray, FloatArray], FloatArray]
) -> FloatArray:
    """Solve for the states (T, D, k) that go with changes of the residuals, (K, k) in each frame."""
    states = search.x[problem.columns]
    poses, decoding = problem.decoder.poses(states), problem.decoder.jacobian(states)
    right = np.zeros(0)
    for t, residual in enumerate(problem.residuals):
        misses, slopes = residual(poses[t])
        changes = problem.loss(misses)[1][:, None] * shifts(t, slopes, poses[t])
        right = right if right.size else np.zeros((len(search.x), changes.shape[1]))
        right[problem.columns[t]] += decoding[t].T @ (slopes.T @ changes)
    factor = search.quadratic.normal.factor()
    return factor.solve(right)[problem.columns]


def _columns(styles: IntArray, n_style: int) -> tuple[IntArray, int]:
    """Return the unknowns (T, D) of each frame, and how many form the border. A single style is the border; several
    stand before the frames they belong to, so that the band stays narrow."""
    n_frames, n_styles = len(styles), int(styles[-1]) + 1
    local = N_LOCAL * np.arange(n_frames)[:, None] + np.arange(N_LOCAL)
    if n_styles == 1:
        shared = np.broadcast_to(N_LOCAL * n_frames + np.arange(n_style), (n_frames, n_style))
        return np.hstack([shared, local]), n_style
    first = np.searchsorted(styles, np.arange(n_styles))  # the first frame of every style
    alpha = (n_style * np.arange(n_styles) + N_LOCAL * first)[:, None] + np.arange(n_style)
    return np.hstack([alpha[styles], local + n_style * (styles + 1)[:, None]]), 0


def _style_rows(styles: IntArray, columns: IntArray, times: FloatArray, new: float) -> list[Row]:
    """Return rows of the autoregression of the styles; columns: (T, d). times: (T,) in frames at PACE_HZ."""
    first = np.searchsorted(styles, np.arange(styles[-1] + 1))
    rows = [(columns[0, k : k + 1], np.ones(1)) for k in range(columns.shape[1])]
    for before, after in pairwise(first):
        kept = max(0.0, 1.0 - new**2) ** (0.5 * (times[after] - times[before]))
        deviation = np.sqrt(1.0 - kept**2)
        pairs = np.stack([columns[before], columns[after]], axis=1)
        rows += [(pair, np.array([-kept, 1.0]) / deviation) for pair in pairs]
    return rows


def second_differences(columns: IntArray, times: FloatArray, deviations: FloatArray) -> list[Row]:
    """Return rows of the second differences of columns (T, m) with deviations (m,); times: (T,) in frames at PACE_HZ.
    Over uneven times the slopes differ by as much as the random walk of a speed does from middle to middle."""
    rows = []
    for t in range(1, len(columns) - 1):
        before, after = 1.0 / np.diff(times[t - 1 : t + 2])
        walked = np.sqrt(0.5 * (times[t + 1] - times[t - 1]))
        values = np.array([before, -before - after, after]) / walked
        rows += [(columns[t - 1 : t + 2, k], values / deviation) for k, deviation in enumerate(deviations)]
    return rows
