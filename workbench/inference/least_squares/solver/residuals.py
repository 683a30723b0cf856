"""Residual functions of prior knowledge about poses, and of the keypoints of several views (see `core.residual`).

The nominal means and standard deviations are over the 479 clips of the CMU and Bandai recordings at 10 Hz. Each of the
23 activities, from walking and running to bows, punches and a dance, has equal weight, and every pose also enters
mirrored.
"""

from collections.abc import Sequence
from types import MappingProxyType

import numpy as np

from workbench.body.kinematics import forward, joint_jacobian
from workbench.body.skeleton import JOINT_NAMES, Skeleton
from workbench.core.observations import Keypoints
from workbench.core.residual import ResidualFunction, keypoint_residual, no_residuals, stacked
from workbench.inference.least_squares.solver.single_frame import GaussianPrior
from workbench.utils.arrays import FloatArray, IntArray

UPRIGHT = slice(4, 6)
"""Columns of pitch and roll in a pose."""
UPRIGHT_SIGMA_RAD = 0.15
"""Standard deviation of pitch and roll in walking and running."""
NOMINAL_RAD = MappingProxyType({
    "root_pitch": (0.13, 0.26), "root_roll": (0.0, 0.6),
    "neck_turn": (0.0, 0.41), "neck_nod": (0.08, 0.34), "neck_tilt": (0.0, 0.15),
    "shoulder_abduction": (0.58, 1.25), "shoulder_flexion": (0.19, 0.73), "shoulder_twist": (-0.07, 1.26),
    "elbow_flexion": (0.99, 0.69), "hip_flexion": (0.44, 0.60), "hip_abduction": (0.07, 0.35),
    "hip_twist": (-0.06, 0.43), "knee_flexion": (0.62, 0.43),
})  # fmt: skip
"""Mean and standard deviation of joint angles, equal on both sides, and of the root's lean. They differ from the
neutral pose's zeros where a single camera needs it: elbows and knees bend one way. The roll in the recordings is within
0.14; the value allows other activities."""
DEFAULT_NOMINAL_RAD = (0.0, 1.0)
"""Mean and standard deviation of unlisted angles, those of other skeletons."""
BALANCE_M, BALANCE_SIGMA_M = (0.043, 0.0), 0.05
"""Mean offset of the centre of mass ahead and to the left of the line between the ankles, standard deviation 0.046 and
0.040 m; no activity's mean differs by more than 0.05 m."""
GROUND_SIGMA_M = 0.03
"""Standard deviation of the height of the lower ankle; 0.02 m in walking, 0.03 m in running."""

_LIMBS = (
    ("shoulder", "elbow", 0.028, 0.436),
    ("elbow", "wrist", 0.022, 0.682),
    ("hip", "knee", 0.100, 0.433),
    ("knee", "ankle", 0.061, 0.606),
)
"""Proximal and distal joint, mass fraction and centre of mass as a fraction of the length, hands and feet included
(Winter, *Biomechanics and Motor Control of Human Movement*, 4th ed. 2009, table 4.1)."""


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


def joint_residual(skeleton: Skeleton, joints: IntArray, points: FloatArray, sigma_m: float) -> ResidualFunction:
    """Return the residual of joints (K,) from 3-D points (K, 3), m; 3 K values."""
    if not len(points):
        return no_residuals

    def residual(pose: FloatArray) -> tuple[FloatArray, FloatArray]:
        offsets = forward(skeleton, pose[None]).positions[0, joints] - points
        jacobian = joint_jacobian(skeleton, pose[None])[0, joints]
        return offsets.ravel() / sigma_m, jacobian.reshape(offsets.size, -1) / sigma_m

    return residual


def upright_residual(skeleton: Skeleton, sigma_rad: float) -> ResidualFunction:
    """Return the residual of the root's pitch and roll, which are small in standing, walking and running and poorly
    observed by one camera."""
    leaning = np.eye(len(skeleton.dof_names))[UPRIGHT] / sigma_rad
    return lambda pose: (leaning @ pose, leaning)


def limit_residual(skeleton: Skeleton, sigma_rad: float) -> ResidualFunction:
    """Return the residual of angles beyond the skeleton's limits; zero within them."""
    lower, upper = skeleton.limits.T

    def residual(pose: FloatArray) -> tuple[FloatArray, FloatArray]:
        beyond = pose - np.clip(pose, lower, upper)
        return beyond / sigma_rad, np.diag(beyond != 0.0) / sigma_rad

    return residual


def nominal_pose_prior(skeleton: Skeleton) -> GaussianPrior:
    """Return independent normal distributions of joint angles, pitch and roll; root position and heading are free."""
    sides = [name.removeprefix("left_").removeprefix("right_") for name in skeleton.dof_names]
    mean, deviation = np.array([NOMINAL_RAD.get(name, DEFAULT_NOMINAL_RAD) for name in sides]).T
    mean[: UPRIGHT.start], deviation[: UPRIGHT.start] = 0.0, np.inf
    return GaussianPrior.independent(mean, deviation)


def nominal_pose_residual(skeleton: Skeleton) -> ResidualFunction:
    """Return the residual of joint angles, pitch and roll from their nominal values."""
    nominal = nominal_pose_prior(skeleton)
    rows = nominal.whitening[UPRIGHT.start :]
    return lambda pose: (rows @ (pose - nominal.mean), rows)


def gaussian_residual(mean: FloatArray, precision: FloatArray) -> ResidualFunction:
    """Return the residual of a pose under N(mean (P,), precision⁻¹ (P, P)); parameters of zero precision are free."""
    rows = np.flatnonzero(np.diagonal(precision))
    jacobian = np.zeros((len(rows), len(mean)))
    jacobian[:, rows] = np.linalg.cholesky(precision[np.ix_(rows, rows)]).T
    return lambda pose: (jacobian @ (pose - mean), jacobian)


def balance_residual(skeleton: Skeleton) -> ResidualFunction:
    """Return the residual of the centre of mass from its nominal position, a little ahead of the line between the
    ankles."""
    masses, left, right = centre_of_mass(skeleton), skeleton.joint("left_ankle"), skeleton.joint("right_ankle")

    def residual(pose: FloatArray) -> tuple[FloatArray, FloatArray]:
        positions = forward(skeleton, pose[None]).positions[0, :, :2]
        jacobian = joint_jacobian(skeleton, pose[None])[0, :, :2]
        offset, d_offset = masses @ positions - positions[left], np.tensordot(masses, jacobian, 1) - jacobian[left]
        stance, d_stance = positions[right] - positions[left], jacobian[right] - jacobian[left]
        square = max(float(stance @ stance), 1e-9)
        fraction = float(offset @ stance) / square  # of the ankle line, at the nearest point
        d_fraction = (stance @ d_offset + (offset - 2.0 * fraction * stance) @ d_stance) / square
        if not 0.0 < fraction < 1.0:
            fraction, d_fraction = min(max(fraction, 0.0), 1.0), np.zeros(len(pose))
        error, d_error = offset - fraction * stance, d_offset - fraction * d_stance - np.outer(stance, d_fraction)
        cos, sin = np.cos(pose[3]), np.sin(pose[3])
        to_heading = np.array([[cos, sin], [-sin, cos]])  # world axes to heading axes
        slope = to_heading @ d_error
        slope[:, 3] += np.array([[-sin, cos], [-cos, -sin]]) @ error
        return (to_heading @ error - BALANCE_M) / BALANCE_SIGMA_M, slope / BALANCE_SIGMA_M

    return residual


def ground_residual(skeleton: Skeleton, ground_m: float) -> ResidualFunction:
    """Return the residual of the lower ankle's height from `ground_m`, that of a standing person's ankles, m."""
    ankles = np.array([skeleton.joint("left_ankle"), skeleton.joint("right_ankle")])

    def residual(pose: FloatArray) -> tuple[FloatArray, FloatArray]:
        heights = forward(skeleton, pose[None]).positions[0, ankles, 2]
        lower = ankles[int(np.argmin(heights))]
        slope = joint_jacobian(skeleton, pose[None])[0, lower, 2:]
        return (heights.min(keepdims=True) - ground_m) / GROUND_SIGMA_M, slope / GROUND_SIGMA_M

    return residual


def centre_of_mass(skeleton: Skeleton) -> FloatArray:
    """Return the weights (J,) of the joints in the centre of mass, see _LIMBS. The trunk's mass is midway between
    pelvis and neck, slightly too high."""
    weights = dict.fromkeys(JOINT_NAMES, 0.0) | {"pelvis": 0.2485, "neck": 0.2485, "head_centre": 0.081}
    for side in ("left", "right"):
        for near, far, mass, along in _LIMBS:
            weights[f"{side}_{near}"] += mass * (1.0 - along)
            weights[f"{side}_{far}"] += mass * along
    total = sum(weights.values())
    return np.array([weights.get(name, 0.0) / total for name in skeleton.names])
