"""Least squares of one frame: decoders from unknowns to poses, and sequential fits of frames."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field, replace
from functools import lru_cache
from typing import Protocol

import numpy as np
from tqdm import tqdm

from workbench.body.skeleton import N_ROOT, Skeleton
from workbench.core.prior import REFERENCE_RATE_HZ, MotionModel, Smoothness
from workbench.core.residual import Loss, ResidualFunction, scaled
from workbench.core.state_space import StateSpace
from workbench.inference.least_squares.solver.sparse_solver import Minimum, Pattern, Quadratic, minimise
from workbench.utils.arrays import FloatArray, IntArray
from workbench.utils.errors import InputError


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
class MotionDecoder:
    """Decoder of states {α (d), μ, root (6)} of paper D: Θ(μ) = Θ₀(μ) + Σ_i α_i Θ_i(μ) (eq. 9) with a separate root.

    α in standard deviations, μ in cycles, unwrapped; root as in a pose. rest: (P,) pose with the fixed angles of
    degrees of freedom outside the model. Raises InputError when the skeleton lacks one of the model's.
    """

    skeleton: Skeleton
    model: MotionModel
    rest: FloatArray
    space: StateSpace = field(init=False)
    dofs: IntArray = field(init=False)

    def __post_init__(self) -> None:
        if unknown := set(self.model.angles) - set(self.skeleton.dof_names[N_ROOT:]):
            raise InputError(f"motion model: the skeleton has no joint angle called {min(unknown)!r}")
        names = self.skeleton.dof_names
        coefficients = tuple(f"a{i + 1}" for i in range(len(self.model.scales)))
        groups = {"coefficients": (coefficients, "σ"), "phase": (("phase",), "cycle")}
        object.__setattr__(self, "space", StateSpace.of(groups | _root_groups(self.skeleton)))
        object.__setattr__(self, "dofs", np.array([names.index(name) for name in self.model.angles]))

    @property
    def n_style(self) -> int:
        """Return d, the number of coefficients."""
        return len(self.model.scales)

    def states(self, alpha: FloatArray, mu: FloatArray, roots: FloatArray) -> FloatArray:
        """Return states (T, d + 7) of coefficients (T, d) or (d,), phases (T,) and roots (T, 6) or (6,)."""
        states = np.empty((len(mu), len(self.space)))
        states[:, : self.n_style], states[:, self.n_style], states[:, -N_ROOT:] = alpha, mu, roots
        return states

    def poses(self, states: FloatArray) -> FloatArray:
        """Return the poses (T, P) of states (T, d + 7)."""
        poses = np.tile(self.rest, (len(states), 1))
        poses[:, :N_ROOT] = states[:, -N_ROOT:]
        poses[:, self.dofs] = self.model.angles_at(states[:, : self.n_style], states[:, self.n_style])
        return poses

    def jacobian(self, states: FloatArray) -> FloatArray:
        """Return their derivative (T, P, d + 7): the chain rule of D, eq. 13–14."""
        jacobian = np.zeros((len(states), len(self.rest), states.shape[1]))
        by_style, by_phase = self.model.jacobian_at(states[:, : self.n_style], states[:, self.n_style])
        jacobian[:, self.dofs, : self.n_style] = by_style
        jacobian[:, self.dofs, self.n_style] = by_phase
        jacobian[:, range(N_ROOT), range(self.n_style + 1, states.shape[1])] = 1.0
        return jacobian


@dataclass(frozen=True, eq=False)
class PoseDecoder:
    """Decoder without a motion model; the state is the pose."""

    skeleton: Skeleton
    space: StateSpace = field(init=False)

    def __post_init__(self) -> None:
        angles = self.skeleton.dof_names[N_ROOT:]
        object.__setattr__(self, "space", StateSpace.of(_root_groups(self.skeleton) | {"angles": (angles, "rad")}))

    def poses(self, states: FloatArray) -> FloatArray:
        """Return the states themselves."""
        return states

    def jacobian(self, states: FloatArray) -> FloatArray:
        """Return identities (T, P, P)."""
        return np.broadcast_to(np.eye(states.shape[1]), (len(states), states.shape[1], states.shape[1]))


def _root_groups(skeleton: Skeleton) -> dict[str, tuple[tuple[str, ...], str]]:
    return {"root_position": (skeleton.dof_names[:3], "m"), "root_rotation": (skeleton.dof_names[3:N_ROOT], "rad")}


LOSS_SCALE_FACTORS = (8.0, 1.0)
"""Successive factors of the loss's scale in the search for a root that may start decimetres away, because residuals far
beyond the scale have no influence (graduated non-convexity, Blake & Zisserman 1987)."""
STEADY_FRAMES = 6
"""Frames over which the phase's speed is averaged in a sequential fit. The last difference alone is so noisy that a
phase may stall, and a phase half a cycle behind does not recover."""
FOLLOWED_STYLE_FRACTION = 0.4
"""Factor of the smoothness of the style in a sequential fit, because one frame alone fits the style to a wrong
phase."""


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


def global_motion(decoder: MotionDecoder, data: FitData, states: FloatArray) -> FloatArray:
    """Return states (T, D) with fitted roots, each searched from the previous frame (paper D, section 4, eq. 10).

    The coefficients and phases of `states` are unchanged, and the root of its first row is the initial one. After two
    frames their linear extrapolation is a second initial value: at 14 Hz a runner's root moves 25 cm a frame.
    """
    free, angles = PoseDecoder(decoder.skeleton), decoder.poses(states)[:, N_ROOT:]
    roots = np.repeat(states[:1, -N_ROOT:], len(states), axis=0)
    for t in tqdm(range(len(states)), desc="global motion", unit="frame", disable=None, leave=False):
        guesses = [roots[max(t - 1, 0)]] + [2.0 * roots[t - 1] - roots[t - 2]] * (t > 1)
        poses = [np.concatenate([guess, angles[t]]) for guess in guesses]
        roots[t] = fit_root(free, data.residuals[t], data.loss, poses, LOSS_SCALE_FACTORS)
    return np.hstack([states[:, :-N_ROOT], roots])


def follow(decoder: MotionDecoder, data: FitData, initial: FloatArray) -> FloatArray:
    """Return states (T, D) of all frames, fitted sequentially after the `initial` ones (F ≥ 2, D).

    Each frame has its own root, phase and coefficients, under the batch's smoothness with the previous frames fixed.
    The phase is predicted with its recent mean speed, and the root is first fitted with a widened loss.
    """
    states, free = list(initial), PoseDecoder(decoder.skeleton)
    gaps, n_style = REFERENCE_RATE_HZ * np.diff(data.times_s), decoder.n_style
    for t in tqdm(range(len(initial), len(data.residuals)), desc="following", unit="frame", disable=None, leave=False):
        before, after = gaps[t - 2 : t]
        predicted = states[t - 1] + (states[t - 1] - states[t - 2]) * (after / before)
        predicted[:n_style] = states[t - 1][:n_style]
        first = max(t - 1 - STEADY_FRAMES, 0)
        speed = (states[t - 1][n_style] - states[first][n_style]) / gaps[first : t - 1].sum()
        predicted[n_style] = states[t - 1][n_style] + speed * after
        deviations = after * np.sqrt(0.5 * (before + after)) * data.smoothness.second_differences
        style = min(1.0, FOLLOWED_STYLE_FRACTION * data.smoothness.style * np.sqrt(after))
        prior = GaussianPrior.independent(predicted, np.concatenate([np.full(n_style, style), deviations]))
        pose = decoder.poses(predicted[None])[0]
        root = fit_root(free, data.residuals[t], data.loss, [pose], LOSS_SCALE_FACTORS[:1])
        state = np.concatenate([predicted[:-N_ROOT], root])
        states.append(fit_frame(decoder, data.residuals[t], data.loss, state, prior=prior).x)
    return np.array(states)


@lru_cache
def _full(n: int) -> Pattern:
    """Return the pattern of a dense matrix."""
    return Pattern(n_band=n, n_border=0, width=n - 1)


def _with(state: FloatArray, columns: IntArray, values: FloatArray) -> FloatArray:
    changed = state.copy()
    changed[columns] = values
    return changed
