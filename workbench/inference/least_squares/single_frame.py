"""Least squares of one frame: how its unknowns become a pose, and fits of one frame after the other."""

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
from workbench.inference.least_squares.solver import Minimum, Pattern, Quadratic, minimise
from workbench.utils.arrays import FloatArray, IntArray
from workbench.utils.errors import InputError


@dataclass(frozen=True, eq=False)
class FitData:
    """T frames to fit: the residuals of each, under a loss, at times (T,), s, rising, and how smoothly poses
    change."""

    residuals: Sequence[ResidualFunction]
    times_s: FloatArray
    loss: Loss
    smoothness: Smoothness = Smoothness()  # noqa: RUF009 - frozen

    def some(self, frames: IntArray) -> "FitData":
        """Take the frames of these indices."""
        return replace(self, residuals=[self.residuals[t] for t in frames], times_s=self.times_s[frames])

    def weighing(self, share: float) -> "FitData":
        """Let every residual count for this share, beside what is known of how poses change."""
        factor = float(np.sqrt(share))
        residuals = [scaled(residual, factor) for residual in self.residuals]
        return replace(self, residuals=residuals, loss=self.loss.wider(factor))

    def spaced(self, shown: Iterable[bool]) -> "FitData":
        """Take of the frames that are `shown` (T,) those no closer than 1 / PACE_HZ to one before."""
        return self.some(spaced(shown, self.times_s))


def spaced(shown: Iterable[bool], times_s: FloatArray) -> IntArray:
    """Select of the frames that are `shown` (T,), at times (T,), those no closer than 1 / PACE_HZ to one before."""
    frames: list[int] = []
    for t in np.flatnonzero(list(shown)):
        if not frames or times_s[t] - times_s[frames[-1]] > 0.99 / REFERENCE_RATE_HZ:
            frames.append(int(t))
    return np.array(frames, dtype=np.intp)


class Decoder(Protocol):
    """Takes states (T, D), one per frame, whose columns `space` names, to poses (T, P)."""

    @property
    def space(self) -> StateSpace: ...

    def poses(self, states: FloatArray) -> FloatArray:
        """Return the poses (T, P) of states (T, D)."""

    def jacobian(self, states: FloatArray) -> FloatArray:
        """Return their derivative (T, P, D)."""


@dataclass(frozen=True, eq=False)
class MotionDecoder:
    """States {α (d), μ, root (6)} of paper D: Θ(μ) = Θ₀(μ) + Σ_i α_i Θ_i(μ) (eq. 9) on a root of its own.

    α in standard deviations, μ in cycles, counted on without wrapping; root as in a pose. rest: (P,) a pose whose
    angles stay for degrees of freedom outside the model. Raises InputError when the skeleton lacks one of the model's.
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
    """No motion model: the state is the pose."""

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


WIDENED = (8.0, 1.0)
"""Scales of the loss, one after the other, with which a root is found that may start decimetres away: a redescending
loss sees nothing further off than its scale (graduated non-convexity, Blake & Zisserman 1987)."""
STEADY_FRAMES = 6
"""Frames over which the phase's speed is taken when a motion is followed: the last difference alone is so noisy that a
phase may stall, and from half a cycle behind nothing brings it back."""
STYLE_HELD = 0.4
"""Part of the smoothness that a style has while a motion is followed: one frame alone bends it to fit a wrong phase."""


@dataclass(frozen=True, eq=False)
class GaussianPrior:
    """A Gaussian over states: whitening (m, D) times (state − mean) is m standard normal numbers. mean: (D,)."""

    mean: FloatArray
    whitening: FloatArray

    @staticmethod
    def independent(mean: FloatArray, deviations: FloatArray) -> "GaussianPrior":
        """Return the Gaussian with these standard deviations (D,); infinite ones leave a number free."""
        return GaussianPrior(mean, np.diag(1.0 / deviations))


def fit_frame(
    decoder: Decoder, residual: ResidualFunction, loss: Loss, state: FloatArray, *, free: IntArray | None = None,
    prior: GaussianPrior | None = None, max_iterations: int = 20, tolerance: float = 1e-3,
) -> Minimum:  # fmt: skip
    """Return the state near `state` (D,) that fits one frame best, over its columns `free` (n,), all by default. The
    minimum's x is the whole state; its quadratic is that of the free columns."""
    free = np.arange(len(state)) if free is None else free
    places = _full(len(free)).place(*np.indices((len(free), len(free))))

    def expand(x: FloatArray) -> Quadratic:
        moved = _with(state, free, x)[None]
        misses, slopes = residual(decoder.poses(moved)[0])
        rho, weights = loss(misses)
        slopes = slopes @ decoder.jacobian(moved)[0][:, free]
        weighted = weights[:, None] * slopes
        cost, gradient, normal = float(rho.sum()), weighted.T @ misses, weighted.T @ slopes
        trust = np.diag(normal).copy()
        if prior is not None:
            apart, rows = prior.whitening @ (moved[0] - prior.mean), prior.whitening[:, free]
            cost += 0.5 * float(apart @ apart)
            gradient += rows.T @ apart
            normal += rows.T @ rows
        return Quadratic(cost, gradient, _full(len(free)).fill(places, normal), trust)

    search = minimise(expand, state[free], max_iterations=max_iterations, tolerance=tolerance)
    return Minimum(_with(state, free, search.x), search.quadratic, search.costs, search.iterations)


def fit_root(
    decoder: PoseDecoder, residual: ResidualFunction, loss: Loss, guesses: Sequence[FloatArray],
    widened: tuple[float, ...],
) -> FloatArray:  # fmt: skip
    """Fit the root (6,) of one frame, its joint angles kept: from that of the poses `guesses` (P,) that fits best at
    first. widened: factors of the loss's scale, one after the other."""
    wide = loss.wider(widened[0])
    pose = min(guesses, key=lambda guess: float(wide(residual(guess)[0])[0].sum())) if len(guesses) > 1 else guesses[0]
    for factor in widened:
        pose = fit_frame(decoder, residual, loss.wider(factor), pose, free=np.arange(N_ROOT)).x
    return pose[:N_ROOT]


def global_motion(decoder: MotionDecoder, data: FitData, states: FloatArray) -> FloatArray:
    """Return the roots of all frames, each from the frame before (paper D, section 4, eq. 10), in states (T, D).

    The coefficients and phases of `states` are kept, and the root of its first row is the start. Where two frames are
    known the next one may also start where their motion leads: at 14 Hz a runner's root moves 25 cm a frame.
    """
    free, angles = PoseDecoder(decoder.skeleton), decoder.poses(states)[:, N_ROOT:]
    roots = np.repeat(states[:1, -N_ROOT:], len(states), axis=0)
    for t in tqdm(range(len(states)), desc="global motion", unit="frame", disable=None, leave=False):
        guesses = [roots[max(t - 1, 0)]] + [2.0 * roots[t - 1] - roots[t - 2]] * (t > 1)
        poses = [np.concatenate([guess, angles[t]]) for guess in guesses]
        roots[t] = fit_root(free, data.residuals[t], data.loss, poses, WIDENED)
    return np.hstack([states[:, :-N_ROOT], roots])


def follow(decoder: MotionDecoder, data: FitData, known: FloatArray) -> FloatArray:
    """Return states (T, D) of all frames, the first ones `info` (F ≥ 2, D), the next followed one by one.

    Each frame has root, phase and coefficients of its own under the batch's smoothness with the frames before held; the
    phase goes on at its mean speed of late, and the root is first found with a wide loss.
    """
    states, free = list(known), PoseDecoder(decoder.skeleton)
    gaps, n_style = REFERENCE_RATE_HZ * np.diff(data.times_s), decoder.n_style
    for t in tqdm(range(len(known), len(data.residuals)), desc="following", unit="frame", disable=None, leave=False):
        before, after = gaps[t - 2 : t]
        ahead = states[t - 1] + (states[t - 1] - states[t - 2]) * (after / before)
        ahead[:n_style] = states[t - 1][:n_style]
        first = max(t - 1 - STEADY_FRAMES, 0)
        speed = (states[t - 1][n_style] - states[first][n_style]) / gaps[first : t - 1].sum()
        ahead[n_style] = states[t - 1][n_style] + speed * after
        bend = after * np.sqrt(0.5 * (before + after)) * data.smoothness.second_differences
        new = min(1.0, STYLE_HELD * data.smoothness.style * np.sqrt(after))
        prior = GaussianPrior.independent(ahead, np.concatenate([np.full(n_style, new), bend]))
        root = fit_root(free, data.residuals[t], data.loss, [decoder.poses(ahead[None])[0]], WIDENED[:1])
        state = np.concatenate([ahead[:-N_ROOT], root])
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
