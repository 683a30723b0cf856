"""Least squares of single frames, the baseline that loses the person (paper D, section 4.1)."""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from tqdm import tqdm

from workbench.body.angles import unwrap_near
from workbench.body.skeleton import N_ROOT, Skeleton
from workbench.core.capabilities import MOTION, Traits, component_traits
from workbench.core.prior import MotionModel
from workbench.core.state_space import StateSpace
from workbench.inference.least_squares.motion.all_frames import FLAT_STD
from workbench.inference.least_squares.motion.first_frame import first_pose
from workbench.inference.least_squares.motion.motion_decoder import MotionDecoder
from workbench.inference.least_squares.motion.motion_fit import required_motion
from workbench.inference.least_squares.motion.task import Fit, Task, fit_of
from workbench.inference.least_squares.solver.residuals import UPRIGHT_SIGMA_RAD
from workbench.inference.least_squares.solver.single_frame import FitData, GaussianPrior, PoseDecoder, fit_frame
from workbench.inference.least_squares.solver.sparse_solver import Minimum
from workbench.utils.arrays import FloatArray
from workbench.utils.timing import working_s

PRIOR_PHASES = 64
PRIOR_RAD = 0.05
"""Standard deviation of an angle not explained by the motion model."""


@dataclass(frozen=True)
class FrameByFrame:
    """Fit the pose of every frame from that of the previous frame, without a motion model. pose_prior: with the
    Gaussian of the poses of the prior's motion model, see `pose_prior`."""

    @staticmethod
    def traits(keys: Mapping[str, Any]) -> Traits:
        """Declare the need of a motion model for the Gaussian of its poses, if that is chosen."""
        return component_traits(prior=MOTION) if keys.get("pose_prior") else component_traits()

    pose_prior: bool = False

    def space(self, skeleton: Skeleton, motion: MotionModel | None) -> StateSpace:
        """Return the names of the pose's parameters; raises InputError for `pose_prior` without a motion model."""
        if self.pose_prior:
            required_motion(motion)
        return PoseDecoder(skeleton).space

    def fit(self, task: Task, start: FloatArray | None) -> Fit:
        """Return the sequential fit of all frames; `start` as for `LeastSquares.run`."""
        rest = np.zeros(len(task.skeleton.dof_names)) if start is None else start
        prior = (
            pose_prior(MotionDecoder(task.skeleton, required_motion(task.motion), rest)) if self.pose_prior else None
        )
        start = first_pose(task, prior) if start is None else start
        return fit_poses(PoseDecoder(task.skeleton), task.data(UPRIGHT_SIGMA_RAD), start, prior)


def fit_poses(decoder: PoseDecoder, data: FitData, start: FloatArray, prior: GaussianPrior | None = None) -> Fit:
    """Return the fit of each frame from the pose of the previous one (paper D, section 4.1).

    The covariance is the inverse of the Gauss–Newton matrix; parameters without observations or prior have the standard
    deviation FLAT_STD. Joint angles are within half a turn of the middle of their limits, because the twist of a
    straight arm, which no point determines, may make full turns.

    Parameters
    ----------
    start : (P,) pose from which the first frame is fitted.
    prior : Gaussian over poses, or None.
    """
    clock, poses, covariances, searches = working_s(), [start], [], list[Minimum]()
    middle = decoder.skeleton.limits[N_ROOT:].mean(axis=1)
    for residual in tqdm(data.residuals, desc="frame by frame", unit="frame", disable=None, leave=False):
        searches.append(fit_frame(decoder, residual, data.loss, poses[-1], prior=prior, max_iterations=40))
        poses.append(unwrap_near(searches[-1].x, np.concatenate([poses[-1][:N_ROOT], middle])))
        covariances.append(np.linalg.inv(searches[-1].quadratic.normal.dense() + np.eye(len(start)) / FLAT_STD**2))
    iterations = np.mean([search.iterations for search in searches])
    costs = tuple(search.costs[-1] for search in searches)
    fit = fit_of(decoder, data, np.array(poses[1:]), np.array(covariances), float(iterations), costs)
    return replace(fit, timing_s={"least_squares": working_s() - clock})


def pose_prior(decoder: MotionDecoder) -> GaussianPrior:
    """Return the Gaussian of the motion model's poses over all phases and coefficients N(0, 1); the root is free.
    Angles outside the model have the mean of `decoder.rest` and the smallest standard deviation, PRIOR_RAD."""
    phases = np.arange(PRIOR_PHASES) / PRIOR_PHASES
    states = decoder.states(np.zeros(decoder.n_style), phases, np.zeros(N_ROOT))
    poses, by_style = decoder.poses(states), decoder.jacobian(states)[:, :, : decoder.n_style]
    mean = poses.mean(axis=0)
    spread = np.cov(poses.T, bias=True) + np.einsum("tpi,tqi->pq", by_style, by_style) / PRIOR_PHASES
    angles = spread[N_ROOT:, N_ROOT:] + PRIOR_RAD**2 * np.eye(len(mean) - N_ROOT)
    whitening = np.zeros((len(mean) - N_ROOT, len(mean)))
    whitening[:, N_ROOT:] = np.linalg.inv(np.linalg.cholesky(angles))
    return GaussianPrior(mean, whitening)
