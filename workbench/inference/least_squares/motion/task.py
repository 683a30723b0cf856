"""Input and result of a least-squares problem."""

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
from workbench.inference.least_squares.solver.motion_posterior import MotionPosterior
from workbench.inference.least_squares.solver.residuals import upright_residual
from workbench.inference.least_squares.solver.single_frame import Decoder, FitData, inlier_fractions
from workbench.utils.arrays import FloatArray


@dataclass(frozen=True, eq=False)
class Task:
    """Observations and models of T frames to fit. surface: of the body with this skeleton. likelihood: provides the
    residuals.

    observations: one per frame. times_s: (T,), increasing. motion, smoothness: of the prior. phase_ends: phases of the
    first and the last frame, cycles, if available. max_iterations: of a complete search. discrepancy: of the motion
    model for new people. pose_prior: of the last of POSE_NAMES. length_uncertainty: (J, 3, G), see
    `Body.limb_length_std`.
    """

    skeleton: Skeleton
    surface: Surface
    likelihood: ResidualLikelihood
    observations: Sequence[Observed]
    times_s: FloatArray
    motion: MotionModel | None = None
    smoothness: Smoothness = field(default_factory=Smoothness)
    phase_ends: tuple[float, float] | None = None
    max_iterations: int = 40
    discrepancy: Discrepancy | None = None
    pose_prior: PosePrior | None = None
    length_uncertainty: FloatArray | None = None

    @property
    def sigma_px(self) -> float:
        """Return the standard deviation of a keypoint, px; infinite if the likelihood uses none."""
        return self.likelihood.observables.sigma_px or np.inf

    def data(self, upright_rad: float) -> FitData:
        """Return the likelihood's residuals of every frame; frames with keypoints also have an `upright_residual`, and
        so have all frames if keypoints are the only observations."""
        upright = upright_residual(self.skeleton, upright_rad)
        keypoints_only = observed_kinds(self.observations) == ("keypoints",)
        residuals = [
            stacked([self.likelihood.residual_function(frame), *[upright] * (keypoints_only or bool(frame.keypoints))])
            for frame in self.observations
        ]
        return FitData(residuals, self.times_s, self.likelihood.residual_loss, self.smoothness)


@dataclass(frozen=True, eq=False)
class Fit:
    """Result of a fit to T frames. poses: (T, P). covariance: (T, P, P), marginal, of the poses by the Gauss–Newton
    matrix.

    space: names the D columns of `states` (T, D), {α, μ, root} with a motion model, α in standard deviations and μ in
    cycles, unwrapped, else the pose. state_covariance: (T, D, D). pose_jacobian: (T, P, D), of the poses by the states.
    inliers: (T,) fraction of the residuals within the loss's scale, NaN in a frame without observations (omitted
    in its step). iterations: evaluations of all frames together, or per frame without a motion model. costs: of the
    batch, initial and after every accepted step; without a motion model every frame's final one. timing_s: seconds per
    stage.
    posterior: of all frames together, of a fit of smooth poses; 0.7 MB per second of video at 30 Hz.
    discrepancy_root: (T, P, k) A, the pose error by the model discrepancy being A z, z ~ N(0, I); `covariance` includes
    A Aᵀ.
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
    discrepancy_root: FloatArray | None = None
    posterior: MotionPosterior | None = None

    def with_discrepancy(self, discrepancy_root: FloatArray) -> "Fit":
        """Return the fit with `discrepancy_root` set and its covariance added to that of the poses."""
        return replace(
            self,
            covariance=self.covariance + discrepancy_root @ discrepancy_root.transpose(0, 2, 1),
            discrepancy_root=discrepancy_root,
        )


class Problem(Protocol):
    """The unknowns and the regularisation of a least-squares fit."""

    def space(self, skeleton: Skeleton, motion: MotionModel | None) -> StateSpace:
        """Return the names of a frame's unknowns; raises InputError if a required motion model is missing."""

    def fit(self, task: Task, start: FloatArray | None) -> Fit:
        """Return the fit of all frames, from about the pose `start` (P,), or None to search for the person. Raises
        InputError where the frames do not determine an initial pose."""


def fit_of(
    decoder: Decoder, data: FitData, states: FloatArray, covariances: FloatArray, iterations: float,
    costs: tuple[float, ...],
) -> Fit:  # fmt: skip
    """Return the fit of states (T, D) with marginal covariances (T, D, D), decoded to poses."""
    poses, jacobian = decoder.poses(states), decoder.jacobian(states)
    residuals = (residual(pose)[0] for residual, pose in zip(data.residuals, poses, strict=True))
    return Fit(
        space=decoder.space, poses=poses, covariance=jacobian @ covariances @ jacobian.transpose(0, 2, 1),
        states=states, state_covariance=covariances, pose_jacobian=jacobian,
        inliers=inlier_fractions(residuals, data.loss),
        iterations=iterations, costs=costs,
    )  # fmt: skip
