"""Smooth poses of all frames from residual functions: for observations without a batch form, and the tests' reference.

It is the problem of `keypoint_problem` for any observations, frame by frame in plain NumPy.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from tqdm import tqdm

from workbench.body.skeleton import JOINT_NAMES, N_ROOT, Skeleton
from workbench.core.prior import REFERENCE_RATE_HZ, Smoothness
from workbench.core.losses import SQUARED, Loss
from workbench.core.residual import ResidualFunction, robust, stacked
from workbench.inference.least_squares.motion.all_frames import FitProblem, second_differences
from workbench.inference.least_squares.solver.residuals import (
    balance_residual,
    gaussian_residual,
    ground_residual,
    limit_residual,
    nominal_pose_residual,
)
from workbench.inference.least_squares.solver.single_frame import FitData, GaussianPrior, PoseDecoder, fit_frame
from workbench.inference.least_squares.solver.sparse_solver import Quadratic
from workbench.inference.least_squares.video.foot_contact import foot_contact_constraints
from workbench.inference.least_squares.video.keypoint_problem import FOLLOW_SIGMA, LIMIT_SIGMA_RAD
from workbench.utils.arrays import BoolArray, FloatArray, IntArray

BALANCE_LOSS = Loss("huber", 1.0)
"""Robust, because people who jump or lean on something are out of balance."""
GROUND_LOSS = Loss("huber", 2.0)
"""Robust, because people jump, and there are steps."""


@dataclass(frozen=True, eq=False)
class ResidualProblem:
    """Problem of T frames with `residuals` under `loss`; the other fields as of `KeypointProblem`."""

    skeleton: Skeleton
    residuals: Sequence[ResidualFunction]
    times_s: FloatArray
    loss: Loss
    smoothness: Smoothness
    foot_contacts: BoolArray
    ground_m: float | None = None
    pose_prior: tuple[FloatArray, FloatArray] | None = None

    def select_frames(self, frames: IntArray) -> "ResidualProblem":
        """Return the problem of the frames with these indices."""
        residuals = [self.residuals[t] for t in frames]
        contacts = self.foot_contacts[frames]
        return replace(self, residuals=residuals, times_s=self.times_s[frames], foot_contacts=contacts)

    def expand(self, x: FloatArray) -> Quadratic:
        """Return the cost at poses x (T P,) and its Gauss–Newton model."""
        return self._problem.expand(x)

    def fit_sequentially(self, start: FloatArray) -> FloatArray:
        """Return poses (T, P), each fitted near the previous one, the first near `start` (P,)."""
        poses, gaps = [start], np.diff(self.times_s, prepend=self.times_s[0] - 1.0 / REFERENCE_RATE_HZ)
        for t in tqdm(range(len(gaps)), desc="following", unit="frame", disable=None, leave=False):
            prior = GaussianPrior.independent(
                poses[-1], np.full(len(start), FOLLOW_SIGMA * np.sqrt(REFERENCE_RATE_HZ * gaps[t]))
            )
            poses.append(fit_frame(PoseDecoder(self.skeleton), self._regularized[t], SQUARED, poses[-1], prior=prior).x)
        return np.array(poses[1:])

    def inliers(self, poses: FloatArray) -> FloatArray:
        """Return the fraction (T,) of the residuals within the loss's scale; NaN in a frame without observations."""
        within = [
            np.abs(residual(pose)[0]) < self.loss.scale for residual, pose in zip(self.residuals, poses, strict=True)
        ]
        return np.array([hits.mean() if len(hits) else np.nan for hits in within])

    @cached_property
    def _regularized(self) -> list[ResidualFunction]:
        """Return each frame's residuals under the loss, with those under a loss of their own: limits, pose prior,
        balance, and the height of the lower foot if that of the ground is known."""
        constraints = [limit_residual(self.skeleton, LIMIT_SIGMA_RAD)]
        if set(JOINT_NAMES) <= set(self.skeleton.names):
            constraints.append(robust(balance_residual(self.skeleton), BALANCE_LOSS))
            if self.ground_m is not None:
                constraints.append(robust(ground_residual(self.skeleton, self.ground_m), GROUND_LOSS))
        if self.pose_prior is None:
            priors = [nominal_pose_residual(self.skeleton)] * len(self.residuals)
        else:
            priors = [gaussian_residual(*gaussian) for gaussian in zip(*self.pose_prior, strict=True)]
        pairs = zip(self.residuals, priors, strict=True)
        return [stacked([robust(residual, self.loss), prior, *constraints]) for residual, prior in pairs]

    @cached_property
    def _problem(self) -> FitProblem:
        n_frames, n_dofs = len(self.residuals), len(self.skeleton.dof_names)
        columns = np.arange(n_frames * n_dofs).reshape(n_frames, n_dofs)
        deviations = [*self.smoothness.second_differences[1:], *[self.smoothness.angle] * (n_dofs - N_ROOT)]
        rows = second_differences(columns, REFERENCE_RATE_HZ * self.times_s, np.array(deviations))
        none = [(columns[0, :1], np.zeros(1))]  # one or two frames have no second differences
        contacts = foot_contact_constraints(self.skeleton, self.foot_contacts, self.times_s)
        data = FitData(self._regularized, self.times_s, SQUARED, self.smoothness)
        return FitProblem.of(
            PoseDecoder(self.skeleton), data, columns, rows or none, n_border=0, pair_residuals=contacts
        )
