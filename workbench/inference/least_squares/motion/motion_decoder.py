"""States of a motion model: their decoder to poses, and fits of one frame after the other (paper D, section 4)."""

from dataclasses import dataclass, field

import numpy as np
from tqdm import tqdm

from workbench.body.skeleton import N_ROOT, Skeleton
from workbench.core.prior import REFERENCE_RATE_HZ, MotionModel
from workbench.core.state_space import StateSpace
from workbench.inference.least_squares.solver.single_frame import (
    LOSS_SCALE_FACTORS,
    FitData,
    GaussianPrior,
    PoseDecoder,
    fit_frame,
    fit_root,
    root_groups,
)
from workbench.utils.arrays import FloatArray, IntArray
from workbench.utils.errors import InputError

STEADY_FRAMES = 6
"""Frames over which the phase's speed is averaged in a sequential fit. The last difference alone is so noisy that a
phase may stall, and a phase half a cycle behind does not recover."""
FOLLOWED_STYLE_FRACTION = 0.4
"""Factor of the smoothness of the style in a sequential fit, because one frame alone fits the style to a wrong
phase."""


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
        object.__setattr__(self, "space", StateSpace.of(groups | root_groups(self.skeleton)))
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
