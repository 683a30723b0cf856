"""All frames' poses from residual functions under a smoothness prior: what has no batch form, and the tests' reference.

It is the problem of `keypoint_problem` for anything that is seen, frame by frame in plain NumPy.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from tqdm import tqdm

from workbench.body.skeleton import JOINT_NAMES, N_ROOT, Skeleton
from workbench.core.prior import REFERENCE_RATE_HZ, Smoothness
from workbench.core.residual import SQUARED, Loss, ResidualFunction, robust, stacked
from workbench.inference.least_squares.all_frames import FitProblem, second_differences
from workbench.inference.least_squares.foot_contact import ties_of_feet
from workbench.inference.least_squares.keypoint_problem import FOLLOW_SIGMA, LIMIT_SIGMA_RAD
from workbench.inference.least_squares.residuals import (
    balance_residual,
    gaussian_residual,
    ground_residual,
    limit_residual,
    usual_residual,
)
from workbench.inference.least_squares.single_frame import FitData, GaussianPrior, PoseDecoder, fit_frame
from workbench.inference.least_squares.solver import Quadratic
from workbench.utils.arrays import BoolArray, FloatArray, IntArray

BALANCE_LOSS = Loss("huber", 1.0)
"""Balance is a habit: who jumps or leans on something is out of it by more than its deviation says."""
GROUND_LOSS = Loss("huber", 2.0)
"""People jump, and there are steps."""


@dataclass(frozen=True, eq=False)
class ResidualProblem:
    """The problem of T frames of which `residuals` are known, under `loss`; the other fields as of
    `KeypointProblem`."""

    skeleton: Skeleton
    residuals: Sequence[ResidualFunction]
    times_s: FloatArray
    loss: Loss
    smoothness: Smoothness
    stand: BoolArray
    ground_m: float | None = None
    usual: tuple[FloatArray, FloatArray] | None = None

    def some(self, frames: IntArray) -> "ResidualProblem":
        """Return the problem of the frames of these indices."""
        residuals = [self.residuals[t] for t in frames]
        return replace(self, residuals=residuals, times_s=self.times_s[frames], stand=self.stand[frames])

    def expand(self, x: FloatArray) -> Quadratic:
        """Return the cost at poses x (T P,) and its Gauss–Newton model."""
        return self._problem.expand(x)

    def followed(self, start: FloatArray) -> FloatArray:
        """Return poses (T, P), each fitted near the one before, the first near `start` (P,)."""
        poses, gaps = [start], np.diff(self.times_s, prepend=self.times_s[0] - 1.0 / REFERENCE_RATE_HZ)
        for t in tqdm(range(len(gaps)), desc="following", unit="frame", disable=None, leave=False):
            prior = GaussianPrior.independent(
                poses[-1], np.full(len(start), FOLLOW_SIGMA * np.sqrt(REFERENCE_RATE_HZ * gaps[t]))
            )
            poses.append(fit_frame(PoseDecoder(self.skeleton), self._bounded[t], SQUARED, poses[-1], prior=prior).x)
        return np.array(poses[1:])

    def inliers(self, poses: FloatArray) -> FloatArray:
        """Return the part (T,) of the residuals within the loss's scale; NaN in a frame that shows nothing."""
        near = [
            np.abs(residual(pose)[0]) < self.loss.scale for residual, pose in zip(self.residuals, poses, strict=True)
        ]
        return np.array([hits.mean() if len(hits) else np.nan for hits in near])

    @cached_property
    def _bounded(self) -> list[ResidualFunction]:
        """What is seen of each frame, under its loss, with what no loss forgives: limits, usual angles or postures,
        balance, and the height of a foot where that of the ground is known."""
        own = [limit_residual(self.skeleton, LIMIT_SIGMA_RAD)]
        if set(JOINT_NAMES) <= set(self.skeleton.names):
            own.append(robust(balance_residual(self.skeleton), BALANCE_LOSS))
            if self.ground_m is not None:
                own.append(robust(ground_residual(self.skeleton, self.ground_m), GROUND_LOSS))
        if self.usual is None:
            usual = [usual_residual(self.skeleton)] * len(self.residuals)
        else:
            usual = [gaussian_residual(*each) for each in zip(*self.usual, strict=True)]
        both = zip(self.residuals, usual, strict=True)
        return [stacked([robust(residual, self.loss), angles, *own]) for residual, angles in both]

    @cached_property
    def _problem(self) -> FitProblem:
        n_frames, n_dofs = len(self.residuals), len(self.skeleton.dof_names)
        columns = np.arange(n_frames * n_dofs).reshape(n_frames, n_dofs)
        own = [*self.smoothness.second_differences[1:], *[self.smoothness.angle] * (n_dofs - N_ROOT)]
        rows = second_differences(columns, REFERENCE_RATE_HZ * self.times_s, np.array(own))
        none = [(columns[0, :1], np.zeros(1))]  # one or two frames have no second differences
        ties = ties_of_feet(self.skeleton, self.stand, self.times_s)
        data = FitData(self._bounded, self.times_s, SQUARED, self.smoothness)
        return FitProblem.of(PoseDecoder(self.skeleton), data, columns, rows or none, n_border=0, ties=ties)
