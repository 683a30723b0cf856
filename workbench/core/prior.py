"""Interface of temporal priors, and their optional capabilities."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from types import MappingProxyType
from typing import Protocol, runtime_checkable

import numpy as np

from workbench.body.skeleton import without_side
from workbench.core.discrepancy import Discrepancy
from workbench.core.pose_prior import PosePrior
from workbench.core.state_space import StateSpace
from workbench.utils.arrays import FloatArray, IntArray

REFERENCE_RATE_HZ = 14.0
"""Frame rate of the standard deviations in `Smoothness` (paper D)."""


@dataclass(frozen=True)
class Smoothness:
    """Smoothness penalty of a fit: standard deviations of changes between frames at REFERENCE_RATE_HZ.

    At other rates, coefficients and velocities follow a random walk. style : change of a coefficient per frame, in
    standard deviations of the model. phase : second differences of μ, cycles. position, rotation : second differences
    of the root, m and rad. angle : second differences of joint angles without a motion model, rad. angles : those of
    single angles, equal on both sides, by their names without the side.
    """

    style: float = 0.3
    phase: float = 0.02
    position: float = 0.03
    rotation: float = 0.03
    angle: float = 0.2
    angles: Mapping[str, float] = field(default_factory=dict)

    def of_angle(self, name: str) -> float:
        """Return the standard deviation, rad, of the second differences of a joint angle."""
        return self.angles.get(without_side(name), self.angle)

    @property
    def second_differences(self) -> FloatArray:
        """Standard deviations (7,) of the second differences of {μ, root}."""
        return np.array([self.phase, *[self.position] * 3, *[self.rotation] * 3])


RECORDED_SMOOTHNESS = Smoothness(
    position=0.013, angle=0.11, angles=MappingProxyType({
        "neck_turn": 0.064, "neck_nod": 0.044, "neck_tilt": 0.047,
        "shoulder_abduction": 0.17, "shoulder_flexion": 0.134, "shoulder_twist": 0.22, "elbow_flexion": 0.22,
        "hip_flexion": 0.117, "hip_abduction": 0.067, "hip_twist": 0.10, "knee_flexion": 0.22,
    }),
)  # fmt: skip
"""Root mean square over 19 to 23 activities in the CMU and Bandai recordings. That of all angles together is half
of the knees', whose swing it would smooth away. Those of single angles are without the six people whose steps are
measured."""


class MotionModel(Protocol):
    """A cyclic motion model of C angles with d coefficients, as a fit uses it; e.g. `motion.models.ActivityModel`.

    angles : names of the C degrees of freedom. scales : (d,) standard deviations of the coefficients. scores (n, d) in
    units of scales, activities (n) and cycle_rate_hz (n,) describe the n training examples.
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
        """Return the derivatives of `angles_at`: (..., C, d) by the coefficients, (..., C) by the phase."""


class Density(Protocol):
    """Transition density p(state_t | state_t−1), for auxiliary weights, Newton steps, MCMC moves and smoothing."""

    @property
    def free(self) -> IntArray:
        """Ascending indices of the free columns, which `log_transition` covers; the other columns depend on them.

        To set a state, set the free columns and call `sample_dependent`. The columns are conditionally independent
        given the previous state if and only if all are free.
        """

    def mean(self, state: FloatArray, dt_s: float) -> FloatArray:
        """Return the noise-free prediction (N, D) of states (N, D) after `dt_s` seconds."""

    def log_transition(self, previous: FloatArray, state: FloatArray, dt_s: float) -> FloatArray:
        """Return log p(state | previous), (...), of states (..., D) `dt_s` seconds apart, which broadcast.

        Columns without noise have no density: log p is −∞ unless they equal their prediction. Dependent columns (see
        `sample_dependent`) are ignored.
        """

    def sample_dependent(
        self, previous: FloatArray, state: FloatArray, dt_s: float, rng: np.random.Generator
    ) -> FloatArray:
        """Return states (N, D) with their dependent columns sampled given the free ones.

        Most priors have no dependent columns and return the states unchanged.
        """


@dataclass(frozen=True, eq=False)
class PriorCapabilities:
    """Optional capabilities of a prior. Wrappers pass on those of their base that remain valid.

    density : the transition density. motion : a cyclic motion model with derivatives, for fits. smoothness : penalty of
    a fit on changes between frames. examples : returns training poses (n, P), candidates for an initial pose from
    annotations. first_pose : returns the initial pose (P,), if the prior determines it. discrepancy : residual of the
    motion model on held-out subjects. pose_prior : static prior over the posture, the last of POSE_NAMES.
    """

    density: Density | None = None
    motion: MotionModel | None = None
    smoothness: Smoothness | None = None
    examples: Callable[[], FloatArray] | None = None
    first_pose: Callable[[], FloatArray] | None = None
    discrepancy: Discrepancy | None = None
    pose_prior: PosePrior | None = None


class Prior(Protocol):
    """Temporal prior p(state_t | state_t−1) over N particles of size D that decode to poses of size P.

    space : names and units of the D columns. parameters : names of the pose parameters that the prior moves; the others
    keep their initial values or follow a given trajectory. capabilities : optional ones, `PriorCapabilities()` if none.
    """

    @property
    def space(self) -> StateSpace: ...
    @property
    def parameters(self) -> tuple[str, ...]: ...
    @property
    def capabilities(self) -> PriorCapabilities: ...

    def sample_initial(self, pose: FloatArray, n: int, rng: np.random.Generator) -> FloatArray:
        """Sample n initial states (n, D) around an initial pose (P,)."""

    def sample_transition(self, state: FloatArray, dt_s: float, rng: np.random.Generator) -> FloatArray:
        """Sample from p(state_t | state_t−1), (N, D), once for each state (N, D), `dt_s` seconds later."""

    def pose(self, state: FloatArray) -> FloatArray:
        """Return the poses (N, P) of states (N, D)."""


@runtime_checkable
class Proposing(Protocol):
    """A prior with a proposal distribution of its own and importance weights that correct for it."""

    def propose(self, state: FloatArray, dt_s: float, rng: np.random.Generator) -> tuple[FloatArray, FloatArray]:
        """Sample states (N, D) `dt_s` seconds later; return them with their log importance weights (N,)."""


def propose(prior: Prior, state: FloatArray, dt_s: float, rng: np.random.Generator) -> tuple[FloatArray, FloatArray]:
    """Sample from the prior's proposal, else from `sample_transition`; return states and log weights (N,)."""
    if isinstance(prior, Proposing):
        return prior.propose(state, dt_s, rng)
    return prior.sample_transition(state, dt_s, rng), np.zeros(len(state))
