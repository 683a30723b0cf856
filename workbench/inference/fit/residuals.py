"""What fits know of a pose beside what is seen, as residual functions (see `core.residual`), and keypoints with it."""

from collections.abc import Sequence

import numpy as np

from workbench.arrays import FloatArray, IntArray
from workbench.body.kinematics import forward, joint_jacobian
from workbench.body.skeleton import Skeleton
from workbench.core.observation_residuals import keypoint_residual
from workbench.core.observations import Keypoints
from workbench.core.residual import ResidualFunction, nothing, stacked

UPRIGHT = slice(4, 6)
"""Pitch and roll in a pose."""
UPRIGHT_SIGMA_RAD = 0.15
"""Deviation of pitch and roll of people who walk or run."""


def views_residual(
    skeleton: Skeleton, seen: Sequence[Keypoints], sigma_px: float, upright: float = UPRIGHT_SIGMA_RAD
) -> ResidualFunction:
    """Measure how far joints are off one frame's keypoints in all views, with a deviation of sigma_px over the root of
    the weight, and how far the root leans, with the deviation `upright`, rad, see `upright_residual`."""
    views = [keypoint_residual(skeleton, one.camera, one.joints, one.marks, sigma_px) for one in seen]
    return stacked([*views, upright_residual(skeleton, upright)])


def joint_residual(skeleton: Skeleton, joints: IntArray, points: FloatArray, sigma_m: float) -> ResidualFunction:
    """Measure how far joints (K,) of the skeleton are off the points (K, 3), m, that they are known to be; 3 K
    residuals."""
    if not len(points):
        return nothing

    def residual(pose: FloatArray) -> tuple[FloatArray, FloatArray]:
        apart = forward(skeleton, pose[None]).positions[0, joints] - points
        slopes = joint_jacobian(skeleton, pose[None])[0, joints]
        return apart.ravel() / sigma_m, slopes.reshape(apart.size, -1) / sigma_m

    return residual


def upright_residual(skeleton: Skeleton, sigma_rad: float) -> ResidualFunction:
    """Measure pitch and roll of the root, small in people who stand, walk or run, and badly seen by one camera."""
    leaning = np.eye(len(skeleton.dof_names))[UPRIGHT] / sigma_rad

    def residual(pose: FloatArray) -> tuple[FloatArray, FloatArray]:
        return leaning @ pose, leaning

    return residual


def limit_residual(skeleton: Skeleton, sigma_rad: float) -> ResidualFunction:
    """Measure by how much angles are beyond the skeleton's limits; zero within."""
    low, high = skeleton.limits.T

    def residual(pose: FloatArray) -> tuple[FloatArray, FloatArray]:
        beyond = pose - np.clip(pose, low, high)
        return beyond / sigma_rad, np.diag(beyond != 0.0) / sigma_rad

    return residual
