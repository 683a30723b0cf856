"""Least squares of single frames, the baseline that loses the person (paper D, section 4.1)."""

from dataclasses import dataclass, replace
from typing import ClassVar

import numpy as np
from tqdm import tqdm

from workbench.body.angles import unwrap_near
from workbench.body.skeleton import N_ROOT, Skeleton
from workbench.core.capabilities import Traits, component_traits
from workbench.core.prior import MotionModel
from workbench.core.state_space import StateSpace
from workbench.inference.least_squares.motion.all_frames import FLAT_STD
from workbench.inference.least_squares.motion.first_frame import first_pose
from workbench.inference.least_squares.motion.task import Fit, Task, fit_of
from workbench.inference.least_squares.solver.residuals import UPRIGHT_SIGMA_RAD
from workbench.inference.least_squares.solver.single_frame import FitData, PoseDecoder, fit_frame
from workbench.inference.least_squares.solver.sparse_solver import Minimum
from workbench.utils.arrays import FloatArray
from workbench.utils.timing import working_s


@dataclass(frozen=True)
class FrameByFrame:
    """Fit the pose of every frame from that of the previous frame, without a motion model."""

    traits: ClassVar[Traits] = component_traits()

    def space(self, skeleton: Skeleton, motion: MotionModel | None) -> StateSpace:
        """Return the names of the pose's parameters."""
        return PoseDecoder(skeleton).space

    def fit(self, task: Task, start: FloatArray | None) -> Fit:
        """Return the sequential fit of all frames; `start` as for `LeastSquares.run`."""
        start = first_pose(task) if start is None else start
        return fit_poses(PoseDecoder(task.skeleton), task.data(UPRIGHT_SIGMA_RAD), start)


def fit_poses(decoder: PoseDecoder, data: FitData, start: FloatArray) -> Fit:
    """Return the fit of each frame from the pose of the previous one, the first from `start` (P,) (paper D, section
    4.1).

    The covariance is the inverse of the Gauss–Newton matrix; parameters without observations have the standard
    deviation FLAT_STD. Joint angles are within half a turn of the middle of their limits, because the twist of a
    straight arm, which no point determines, may make full turns.
    """
    clock, poses, covariances, searches = working_s(), [start], [], list[Minimum]()
    middle = decoder.skeleton.limits[N_ROOT:].mean(axis=1)
    for residual in tqdm(data.residuals, desc="frame by frame", unit="frame", disable=None, leave=False):
        searches.append(fit_frame(decoder, residual, data.loss, poses[-1], max_iterations=40))
        poses.append(unwrap_near(searches[-1].x, np.concatenate([poses[-1][:N_ROOT], middle])))
        covariances.append(np.linalg.inv(searches[-1].quadratic.normal.dense() + np.eye(len(start)) / FLAT_STD**2))
    iterations = np.mean([search.iterations for search in searches])
    costs = tuple(search.costs[-1] for search in searches)
    fit = fit_of(decoder, data, np.array(poses[1:]), np.array(covariances), float(iterations), costs)
    return replace(fit, timing_s={"least_squares": working_s() - clock})
