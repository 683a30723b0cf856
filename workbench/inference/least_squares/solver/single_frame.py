"""Least squares of one frame, and the data and decoders that it shares with fits of all frames."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field, replace
from functools import lru_cache
from typing import Protocol

import numpy as np

from workbench.body.skeleton import N_ROOT, Skeleton
from workbench.core.losses import Loss
from workbench.core.prior import REFERENCE_RATE_HZ, Smoothness
from workbench.core.residual import ResidualFunction, scaled
from workbench.core.state_space import StateSpace
from workbench.inference.least_squares.solver.sparse_solver import Minimum, Pattern, Quadratic, minimise
from workbench.utils.arrays import FloatArray, IntArray


@dataclass(frozen=True, eq=False)
class FitData:
    """Residual functions of T frames at increasing times (T,), s, with their loss and the smoothness of the poses."""

    residuals: Sequence[ResidualFunction]
    times_s: FloatArray
    loss: Loss
    smoothness: Smoothness = Smoothness()  # noqa: RUF009 - frozen

    def select_frames(self, frames: IntArray) -> "FitData":
        """Return the data of the frames with these indices."""
        return replace(self, residuals=[self.residuals[t] for t in frames], times_s=self.times_s[frames])

    def downweighted(self, weight: float) -> "FitData":
        """Return the data with every term of the cost multiplied by `weight`; the smoothness is unchanged."""
        factor = float(np.sqrt(weight))
        residuals = [scaled(residual, factor) for residual in self.residuals]
        return replace(self, residuals=residuals, loss=self.loss.widened(factor))

    def select_spaced(self, visible: Iterable[bool]) -> "FitData":
        """Return the data of the `visible` (T,) frames that are at least 1 / REFERENCE_RATE_HZ apart."""
        return self.select_frames(select_spaced(visible, self.times_s))


def inlier_fractions(residuals: Iterable[FloatArray], loss: Loss) -> FloatArray:
    """Return the fraction (T,) of each frame's residuals within the loss's scale; NaN in a frame without any."""
    within = [np.abs(values) < loss.scale for values in residuals]
    return np.array([hits.mean() if len(hits) else np.nan for hits in within])


def select_spaced(visible: Iterable[bool], times_s: FloatArray) -> IntArray:
    """Return the indices of the `visible` (T,) frames, at times (T,), that are at least 1 / REFERENCE_RATE_HZ apart."""
    frames: list[int] = []
    for t in np.flatnonzero(list(visible)):
        if not frames or times_s[t] - times_s[frames[-1]] > 0.99 / REFERENCE_RATE_HZ:
            frames.append(int(t))
    return np.array(frames, dtype=np.intp)


class Decoder(Protocol):
    """Maps states (T, D), one per frame, to poses (T, P). space: names of the state's columns."""

    @property
    def space(self) -> StateSpace: ...

    def poses(self, states: FloatArray) -> FloatArray:
        """Return the poses (T, P) of states (T, D)."""

    def jacobian(self, states: FloatArray) -> FloatArray:
        """Return their derivative (T, P, D)."""


@dataclass(frozen=True, eq=False)
class PoseDecoder:
    """Decoder without a motion model; the state is the pose."""

    skeleton: Skeleton
    space: StateSpace = field(init=False)

    def __post_init__(self) -> None:
        angles = self.skeleton.dof_names[N_ROOT:]
        object.__setattr__(self, "space", StateSpace.of(root_groups(self.skeleton) | {"angles": (angles, "rad")}))

    def poses(self, states: FloatArray) -> FloatArray:
        """Return the states themselves."""
        return states

    def jacobian(self, states: FloatArray) -> FloatArray:
        """Return identities (T, P, P)."""
        return np.broadcast_to(np.eye(states.shape[1]), (len(states), states.shape[1], states.shape[1]))


def root_groups(skeleton: Skeleton) -> dict[str, tuple[tuple[str, ...], str]]:
    """Return the root's columns of a state, by group, with their units."""
    return {"root_position": (skeleton.dof_names[:3], "m"), "root_rotation": (skeleton.dof_names[3:N_ROOT], "rad")}


LOSS_SCALE_FACTORS = (8.0, 1.0)
"""Successive factors of the loss's scale in the search for a root that may start decimetres away, because residuals far
beyond the scale have no influence (graduated non-convexity, Blake & Zisserman 1987)."""


@dataclass(frozen=True, eq=False)
class GaussianPrior:
    """A Gaussian over states: whitening (m, D) · (state − mean (D,)) is standard normal (m,)."""

    mean: FloatArray
    whitening: FloatArray

    @staticmethod
    def independent(mean: FloatArray, deviations: FloatArray) -> "GaussianPrior":
        """Return the Gaussian with these standard deviations (D,); columns of infinite deviation are free."""
        return GaussianPrior(mean, np.diag(1.0 / deviations))


def fit_frame(
    decoder: Decoder, residual: ResidualFunction, loss: Loss, state: FloatArray, *, free: IntArray | None = None,
    prior: GaussianPrior | None = None, max_iterations: int = 20, tolerance: float = 1e-3,
) -> Minimum:  # fmt: skip
    """Return the minimum of one frame's cost, searched from `state` (D,) over its columns `free` (n,), by default all.
    The minimum's x is the whole state, its quadratic that of the free columns."""
    free = np.arange(len(state)) if free is None else free
    indices = _full(len(free)).flat_index(*np.indices((len(free), len(free))))

    def expand(x: FloatArray) -> Quadratic:
        candidate = _with(state, free, x)[None]
        residuals, jacobian = residual(decoder.poses(candidate)[0])
        rho, weights = loss(residuals)
        jacobian = jacobian @ decoder.jacobian(candidate)[0][:, free]
        weighted = weights[:, None] * jacobian
        cost, gradient, normal = float(rho.sum()), weighted.T @ residuals, weighted.T @ jacobian
        damping_diagonal = np.diag(normal).copy()
        if prior is not None:
            deviations, rows = prior.whitening @ (candidate[0] - prior.mean), prior.whitening[:, free]
            cost += 0.5 * float(deviations @ deviations)
            gradient += rows.T @ deviations
            normal += rows.T @ rows
        return Quadratic(cost, gradient, _full(len(free)).assemble(indices, normal), damping_diagonal)

    search = minimise(expand, state[free], max_iterations=max_iterations, tolerance=tolerance)
    return Minimum(_with(state, free, search.x), search.quadratic, search.costs, search.iterations)


def fit_root(
    decoder: PoseDecoder, residual: ResidualFunction, loss: Loss, guesses: Sequence[FloatArray],
    widened: tuple[float, ...],
) -> FloatArray:  # fmt: skip
    """Return the root (6,) fitted to one frame with fixed joint angles.

    Parameters
    ----------
    guesses : poses (P,); the search starts from the one of lowest cost.
    widened : successive factors of the loss's scale.
    """
    wide = loss.widened(widened[0])
    pose = min(guesses, key=lambda guess: float(wide(residual(guess)[0])[0].sum())) if len(guesses) > 1 else guesses[0]
    for factor in widened:
        pose = fit_frame(decoder, residual, loss.widened(factor), pose, free=np.arange(N_ROOT)).x
    return pose[:N_ROOT]


@lru_cache
def _full(n: int) -> Pattern:
    """Return the pattern of a dense matrix."""
    return Pattern(n_band=n, n_border=0, width=n - 1)


def _with(state: FloatArray, columns: IntArray, values: FloatArray) -> FloatArray:
    changed = state.copy()
    changed[columns] = values
    return changed
