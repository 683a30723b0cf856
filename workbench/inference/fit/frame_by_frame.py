"""The problem of every frame on its own, the baseline that loses the person (paper D, section 4.1)."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from time import perf_counter
from typing import Any

import numpy as np

from workbench.arrays import FloatArray
from workbench.body.skeleton import Skeleton
from workbench.core.motion_model import MotionModel
from workbench.core.residual import Loss, ResidualFunction
from workbench.core.state_space import StateSpace
from workbench.core.traits import MOTION, Traits, offering
from workbench.inference.fit.decoding import MotionDecoder, PoseDecoder
from workbench.inference.fit.first_guess import first_pose
from workbench.inference.fit.frame import Gaussian, pose_prior, track_poses
from workbench.inference.fit.motion_fit import needed
from workbench.inference.fit.residuals import UPRIGHT_SIGMA_RAD
from workbench.inference.fit.task import Fit, Task, fit_of


@dataclass(frozen=True)
class FrameByFrame:
    """Fit the pose of every frame from that of the frame before, without a motion model.

    pose_prior: under the Gaussian of the poses that the prior's motion model makes, see `frame.pose_prior`.
    """

    @staticmethod
    def traits(keys: Mapping[str, Any]) -> Traits:
        """Declare the need of a motion model for the Gaussian of its poses, where that is asked for."""
        return offering(prior=MOTION) if keys.get("pose_prior") else offering()

    pose_prior: bool = False

    def space(self, skeleton: Skeleton, motion: MotionModel | None) -> StateSpace:
        """Name the pose's parameters; raises InputError with `pose_prior` and no motion model."""
        if self.pose_prior:
            needed(motion)
        return PoseDecoder(skeleton).space

    def fit(self, task: Task, start: FloatArray | None) -> Fit:
        """Fit all frames, one after the other; `start` as for `LeastSquares.run`."""
        rest = np.zeros(len(task.skeleton.dof_names)) if start is None else start
        prior = pose_prior(MotionDecoder(task.skeleton, needed(task.motion), rest)) if self.pose_prior else None
        start = first_pose(task, prior) if start is None else start
        return fit_poses(PoseDecoder(task.skeleton), task.residuals(UPRIGHT_SIGMA_RAD), task.loss, start, prior)


def fit_poses(
    decoder: PoseDecoder,
    residuals: Sequence[ResidualFunction],
    loss: Loss,
    start: FloatArray,
    prior: Gaussian | None = None,
) -> Fit:
    """Fit poses frame by frame from a pose (P,), with a Gaussian prior over poses or not."""
    clock = perf_counter()
    poses, covariances, searches = track_poses(decoder, residuals, loss, start, prior)
    iterations = float(np.mean([search.iterations for search in searches]))
    costs = tuple(search.costs[-1] for search in searches)
    fit = fit_of(decoder, residuals, loss, poses, covariances, iterations, costs)
    return replace(fit, timing_s={"least_squares": perf_counter() - clock})
