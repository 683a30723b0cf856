"""What every prior offers, and what some can do beside drawing."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Protocol, runtime_checkable

import numpy as np

from workbench.core.discrepancy import Discrepancy
from workbench.core.pose_prior import PosePrior
from workbench.core.state_space import StateSpace
from workbench.utils.arrays import FloatArray, IntArray

REFERENCE_RATE_HZ = 14.0
"""The frames a second for which `Smoothness` is given, paper D's."""


@dataclass(frozen=True)
class Smoothness:
    """Standard deviations of what may change between frames at PACE_HZ; over other times as a random walk of the
    coefficients and of the speeds.

    style: the part of a coefficient that is new in every frame, in standard deviations of the model. phase: second
    differences of μ, cycles. position, rotation: second differences of the root, m and rad. angle: those of joint
    angles without a motion model, rad.
    """

    style: float = 0.3
    phase: float = 0.02
    position: float = 0.03
    rotation: float = 0.03
    angle: float = 0.2

    @property
    def second_differences(self) -> FloatArray:
        """Return those (7,) of {μ, root}."""
        return np.array([self.phase, *[self.position] * 3, *[self.rotation] * 3])


RECORDED = Smoothness(position=0.013, angle=0.11)
"""Rms over 23 activities in CMU's and Bandai's recordings."""


class MotionModel(Protocol):
    """What a fit asks of a learned motion, C angles with d coefficients; `learning.activities.ActivityModel` is one.

    angles: the C degrees of freedom it speaks of. scales: (d,) standard deviations of the coefficients. Of the n
    examples it was learned from: scores (n, d) in units of scales, activities, and cycle_rate_hz (n,).
    """

    @property
    def angles(self) -> tuple[str, ...]: ...
    @property
    def scales(self) -> FloatArray: ...
    @property
    def scores(self) -> FloatArray: ...
    @property
    def activities(self) -> tuple[str, ...]: ...
    @property
    def cycle_rate_hz(self) -> FloatArray: ...

    def angles_at(self, alpha: FloatArray, mu: FloatArray) -> FloatArray:
        """Return angles (..., C), rad, for coefficients (..., d) in units of scales at phases (...,), cycles."""

    def jacobian_at(self, alpha: FloatArray, mu: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return their derivatives (..., C, d) by the coefficients and (..., C) by the phase."""


class Density(Protocol):
    """p(state_t | state_t−1) as a density, which auxiliary weights, Newton steps, MCMC moves and smoothing need."""

    @property
    def free(self) -> IntArray:
        """Return indices of the columns that `log_transition` speaks of, ascending: all, unless some follow.

        Whoever sets a state sets these and then calls `sample_dependent`. Where some follow, the columns are not
        independent of each other given the previous state; where none do, they are.
        """

    def mean(self, state: FloatArray, dt_s: float) -> FloatArray:
        """Predict where states (N, D) are `dt_s` seconds later when the noise is zero, (N, D)."""

    def log_transition(self, previous: FloatArray, state: FloatArray, dt_s: float) -> FloatArray:
        """Return log p(state | previous), (...), of states (..., D) `dt_s` seconds apart, which broadcast.

        Columns without noise have no density: log p is −∞ where they are not as the previous state says. Columns that
        follow from the others (see `sample_dependent`) are not looked at.
        """

    def sample_dependent(
        self, previous: FloatArray, state: FloatArray, dt_s: float, rng: np.random.Generator
    ) -> FloatArray:
        """Return states (N, D) whose free columns were set by somebody, with the others drawn given those. For most
        priors there are no others, and the states come back as they are."""


@runtime_checkable
class Gaussian(Density, Protocol):
    """A density with Gaussian noise about its mean, which a Kalman filter needs."""

    def start_moments(self, pose: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return mean (D,) and covariance (D, D) of the first states around a starting pose (P,)."""

    def noise_covariance(self, state: FloatArray, dt_s: float) -> FloatArray:
        """Return the covariance (D, D) of states `dt_s` seconds after one state (D,), about their mean."""


@dataclass(frozen=True, eq=False)
class PriorCapabilities:
    """What a prior can do beside drawing. Wrappers pass on those of their base that still hold.

    density: see `Density`. motion: a cyclic motion that a fit can turn into poses with derivatives. smoothness: by how
    much a fit lets its poses change from frame to frame, its penalty. examples: gives poses (n, P) of people that the
    prior knows, among which a start in marks is looked for. first_pose: gives the pose (P,) to start from, where the
    prior itself knows it. discrepancy: what its motion misses of people it was not learned from. postures: which ones
    people take, the last numbers of a pose, whatever went before.
    """

    density: Density | None = None
    motion: MotionModel | None = None
    smoothness: Smoothness | None = None
    examples: Callable[[], FloatArray] | None = None
    first_pose: Callable[[], FloatArray] | None = None
    discrepancy: Discrepancy | None = None
    postures: PosePrior | None = None


class Prior(Protocol):
    """Temporal prior p(state_t | state_t−1) over N particles of size D that decode to poses of size P.

    space: names and units of the D columns. parameters: names of the pose's parameters that move; the others stay as
    they start, or go as is known of them. powers: what it can do beside drawing; `PriorCapabilities()` for nothing.
    """

    @property
    def space(self) -> StateSpace: ...
    @property
    def parameters(self) -> tuple[str, ...]: ...
    @property
    def capabilities(self) -> PriorCapabilities: ...

    def sample_initial(self, pose: FloatArray, n: int, rng: np.random.Generator) -> FloatArray:
        """Return N states (N, D) spread around a starting pose (P,)."""

    def sample_transition(self, state: FloatArray, dt_s: float, rng: np.random.Generator) -> FloatArray:
        """Draw once (N, D) from p(state_t | state_t−1) for each state (N, D), `dt_s` seconds later."""

    def pose(self, state: FloatArray) -> FloatArray:
        """Return the poses (N, P) that states (N, D) stand for."""


@runtime_checkable
class Proposing(Protocol):
    """A prior that draws from a proposal and says by which weights its draws stand for the prior."""

    def propose(self, state: FloatArray, dt_s: float, rng: np.random.Generator) -> tuple[FloatArray, FloatArray]:
        """Draw states (N, D) `dt_s` seconds later; returns the log weights (N,) that correct for it too."""


def propose(prior: Prior, state: FloatArray, dt_s: float, rng: np.random.Generator) -> tuple[FloatArray, FloatArray]:
    """Draw by the prior's own proposal, or where it has none by `sample_transition`, with log weights (N,) of zero."""
    if isinstance(prior, Proposing):
        return prior.propose(state, dt_s, rng)
    return prior.sample_transition(state, dt_s, rng), np.zeros(len(state))
