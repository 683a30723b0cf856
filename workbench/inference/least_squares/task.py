"""What a least-squares problem is given, and what it gives back."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Protocol

import numpy as np

from workbench.body.skeleton import Skeleton
from workbench.body.surface import Surface
from workbench.core.discrepancy import Discrepancy
from workbench.core.observations import Observed, observed_kinds
from workbench.core.pose_prior import PosePrior
from workbench.core.prior import MotionModel, Smoothness
from workbench.core.residual import ResidualLikelihood, stacked
from workbench.core.state_space import StateSpace
from workbench.inference.least_squares.residuals import upright_residual
from workbench.inference.least_squares.single_frame import Decoder, FitData
from workbench.utils.arrays import FloatArray


@dataclass(frozen=True, eq=False)
class Task:
    """T frames to fit a person to. surface: of the body with this skeleton. likelihood: whose residuals are minimised.

    seen: what each frame shows. times_s: (T,), rising. motion, smoothness: what a prior knows of how people move.
    phase_ends: phases of the first and the last frame, cycles, where they are known. max_iterations: of a whole search.
    discrepancy: what the motion misses of people it was not learned from. postures: which ones people take, the last
    numbers of a pose. length_doubt: (J, 3, G), see `Body.limb_length_std`.
    """

    skeleton: Skeleton
    surface: Surface
    likelihood: ResidualLikelihood
    seen: Sequence[Observed]
    times_s: FloatArray
    motion: MotionModel | None = None
    smoothness: Smoothness = field(default_factory=Smoothness)
    phase_ends: tuple[float, float] | None = None
    max_iterations: int = 40
    discrepancy: Discrepancy | None = None
    postures: PosePrior | None = None
    length_doubt: FloatArray | None = None

    @property
    def sigma_px(self) -> float:
        """Return deviation of a keypoint, px; infinite where the likelihood does not look at any."""
        return self.likelihood.observables.sigma_px or np.inf

    def data(self, upright_rad: float) -> FitData:
        """Make the likelihood's residuals of every frame; with keypoints comes an upright person, see
        `upright_residual`. Where keypoints are all there is, the person is upright in the frames between them too."""
        upright = upright_residual(self.skeleton, upright_rad)
        alone = observed_kinds(self.seen) == ("keypoints",)
        residuals = [
            stacked([self.likelihood.residual_function(frame), *[upright] * (alone or bool(frame.keypoints))])
            for frame in self.seen
        ]
        return FitData(residuals, self.times_s, self.likelihood.residual_loss, self.smoothness)


@dataclass(frozen=True, eq=False)
class Fit:
    """T frames fitted. poses: (T, P). covariance: (T, P, P), marginal, of the poses by the Gauss–Newton matrix.

    space: names the D columns of `states` (T, D), {α, μ, root} with a motion model, α in standard deviations and μ in
    cycles, counted on, else the pose. state_covariance: (T, D, D). pose_jacobian: (T, P, D) that takes one covariance
    to the other. inliers: (T,) part of the residuals within the loss's scale, NaN in a frame that shows nothing (0 in
    its step). iterations: evaluations of all frames together, or per frame without a motion model. costs: of the batch,
    at the start and after every accepted step; without a motion model every frame's last. timing_s: seconds per stage.
    missed: (T, P, k), times k standard normal numbers by how much poses are off for what the motion model misses, which
    `covariance` has too.
    """

    space: StateSpace
    poses: FloatArray
    covariance: FloatArray
    states: FloatArray
    state_covariance: FloatArray
    pose_jacobian: FloatArray
    inliers: FloatArray
    iterations: float
    costs: tuple[float, ...]
    timing_s: Mapping[str, float] = field(default_factory=dict)
    missed: FloatArray | None = None

    def missing(self, missed: FloatArray) -> "Fit":
        """Return the fit with what the motion model misses, see `missed`, added to the covariance of the poses."""
        return replace(self, covariance=self.covariance + missed @ missed.transpose(0, 2, 1), missed=missed)


class Problem(Protocol):
    """Which unknowns least squares looks for, and what holds them beside what is seen."""

    def space(self, skeleton: Skeleton, motion: MotionModel | None) -> StateSpace:
        """Return names of a frame's unknowns; raises InputError where the problem lacks a motion model."""

    def fit(self, task: Task, start: FloatArray | None) -> Fit:
        """Return the fit of all frames, from about the pose `start` (P,), or None to find the person. Raises InputError
        where the frames do not tell where to start."""


def fit_of(
    decoder: Decoder, data: FitData, states: FloatArray, covariances: FloatArray, iterations: float,
    costs: tuple[float, ...],
) -> Fit:  # fmt: skip
    """Return what states (T, D) with marginal covariances (T, D, D) mean for the poses."""
    poses, jacobian = decoder.poses(states), decoder.jacobian(states)
    near = [np.abs(residual(pose)[0]) < data.loss.scale for residual, pose in zip(data.residuals, poses, strict=True)]
    return Fit(
        space=decoder.space, poses=poses, covariance=jacobian @ covariances @ jacobian.transpose(0, 2, 1),
        states=states, state_covariance=covariances, pose_jacobian=jacobian,
        inliers=np.array([hits.mean() if len(hits) else np.nan for hits in near]),
        iterations=iterations, costs=costs,
    )  # fmt: skip
