"""Residual functions of prior knowledge about poses, and of the keypoints of several views (see `core.residual`).

The nominal values are over 471 clips of the CMU and Bandai recordings at 10 Hz, without the six people whose steps are
measured. Each of the 18 activities, from walking and running to bows, kicks and a dance, has equal weight, and every
pose also enters mirrored.
"""

from collections.abc import Sequence
from types import MappingProxyType

import numpy as np

from workbench.body.skeleton import Skeleton, without_side
from workbench.core.observations import Keypoints
from workbench.core.residual import ResidualFunction, keypoint_residual, stacked
from workbench.inference.least_squares.solver.single_frame import GaussianPrior

UPRIGHT = slice(4, 6)
"""Columns of pitch and roll in a pose."""
UPRIGHT_SIGMA_RAD = 0.15
"""Standard deviation of pitch and roll in walking and running."""
NOMINAL_RAD = MappingProxyType({
    "root_pitch": (0.01, 0.26), "root_roll": (0.0, 0.6),
    "neck_turn": (0.0, 0.41), "neck_nod": (0.03, 0.35), "neck_tilt": (0.0, 0.16),
    "shoulder_abduction": (0.32, 1.40), "shoulder_flexion": (-0.11, 0.83), "shoulder_twist": (-0.03, 1.38),
    "elbow_flexion": (0.40, 0.92), "hip_flexion": (0.16, 0.61), "hip_abduction": (0.01, 0.38),
    "hip_twist": (-0.13, 0.46), "knee_flexion": (0.44, 0.46), "ankle_flexion": (0.07, 0.65),
})  # fmt: skip
"""Nominal value of joint angles, equal on both sides, and of the root's lean: the centre of the shortest interval that
contains half of the poses, and the root mean square deviation from it. The distributions are skewed, and their means
hold a walking person's legs bent. The values differ from the neutral pose's zeros where a single camera needs it:
elbows and knees bend one way. The pitch in the recordings is within 0.23 and the roll within 0.09; the values allow
other activities. Ankles have 0.29 in the CMU recordings; no pose prior takes the place of their nominal values, which
have its power, 0.2, as frames are dependent: the factor √5."""
DEFAULT_NOMINAL_RAD = (0.0, 1.0)
"""Nominal value and deviation of unlisted angles, those of other skeletons."""
BALANCE_M, BALANCE_SIGMA_M = (0.043, 0.0), 0.05
"""Mean offset of the centre of mass ahead and to the left of the line between the ankles, standard deviation 0.046 and
0.040 m; no activity's mean differs by more than 0.05 m."""
GROUND_SIGMA_M = 0.03
"""Standard deviation of the height of the lower ankle; 0.02 m in walking, 0.03 m in running."""


def views_residual(
    skeleton: Skeleton, views: Sequence[Keypoints], sigma_px: float, upright: float = UPRIGHT_SIGMA_RAD
) -> ResidualFunction:
    """Return the reprojection residual of one frame's keypoints in all views, and the residual of the root's lean.

    Parameters
    ----------
    sigma_px : standard deviation of a keypoint of weight 1, px, see `keypoint_residual`.
    upright : standard deviation of the lean, rad, see `upright_residual`.
    """
    terms = [keypoint_residual(skeleton, view.camera, view.joints, view.detections, sigma_px) for view in views]
    return stacked([*terms, upright_residual(skeleton, upright)])


def upright_residual(skeleton: Skeleton, sigma_rad: float) -> ResidualFunction:
    """Return the residual of the root's pitch and roll, which are small in standing, walking and running and poorly
    observed by one camera."""
    leaning = np.eye(len(skeleton.dof_names))[UPRIGHT] / sigma_rad
    return lambda pose: (leaning @ pose, leaning)


def nominal_pose_prior(skeleton: Skeleton) -> GaussianPrior:
    """Return independent normal distributions of joint angles, pitch and roll; root position and heading are free."""
    sides = [without_side(name) for name in skeleton.dof_names]
    mean, deviation = np.array([NOMINAL_RAD.get(name, DEFAULT_NOMINAL_RAD) for name in sides]).T
    mean[: UPRIGHT.start], deviation[: UPRIGHT.start] = 0.0, np.inf
    return GaussianPrior.independent(mean, deviation)
