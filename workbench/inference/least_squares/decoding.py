"""What a fit is given of the frames, and how the unknowns of one become its pose: by a motion model, or as they are."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field, replace
from typing import Protocol

import numpy as np

from workbench.body.skeleton import N_ROOT, Skeleton
from workbench.core.prior import PACE_HZ, MotionModel, Smoothness
from workbench.core.residual import Loss, ResidualFunction, scaled
from workbench.core.state_space import StateSpace
from workbench.utils.arrays import BoolArray, FloatArray, IntArray
from workbench.utils.errors import InputError


@dataclass(frozen=True, eq=False)
class FitData:
    """T frames to fit: the residuals of each, under a loss, at times (T,), s, rising, and how smoothly poses change.
    stand: (T, 2) which ankles stand, see `standing_feet`; None where nobody looked."""

    residuals: Sequence[ResidualFunction]
    times_s: FloatArray
    loss: Loss
    smoothness: Smoothness = Smoothness()  # noqa: RUF009 - frozen
    stand: BoolArray | None = None

    def some(self, frames: IntArray) -> "FitData":
        """Take the frames of these indices."""
        stand = None if self.stand is None else self.stand[frames]
        return replace(self, residuals=[self.residuals[t] for t in frames], times_s=self.times_s[frames], stand=stand)

    def weighing(self, share: float) -> "FitData":
        """Let every residual count for this share, beside what is known of how poses change."""
        factor = float(np.sqrt(share))
        residuals = [scaled(residual, factor) for residual in self.residuals]
        return replace(self, residuals=residuals, loss=self.loss.wider(factor))

    def spaced(self, shown: Iterable[bool]) -> "FitData":
        """Take of the frames that are `shown` (T,) those no closer than 1 / PACE_HZ to one before."""
        spaced: list[int] = []
        for t in np.flatnonzero(list(shown)):
            if not spaced or self.times_s[t] - self.times_s[spaced[-1]] > 0.99 / PACE_HZ:
                spaced.append(int(t))
        return self.some(np.array(spaced, dtype=np.intp))


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
