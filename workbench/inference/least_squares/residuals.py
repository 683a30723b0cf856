"""What fits know of a pose beside what is seen, as residual functions (see `core.residual`), and keypoints with it.

The usual poses' numbers are means and standard deviations over the 479 clips of CMU's and Bandai's recordings at 10 Hz,
of which each of the 23 activities counts alike, from walking and running to bows, punches and a dance, and every pose
also mirrored.
"""

from collections.abc import Sequence
from types import MappingProxyType

import numpy as np

from workbench.body.kinematics import forward, joint_jacobian
from workbench.body.skeleton import JOINT_NAMES, Skeleton
from workbench.core.observations import Keypoints
from workbench.core.residual import ResidualFunction, keypoint_residual, nothing, stacked
from workbench.inference.least_squares.single_frame import GaussianPrior
from workbench.utils.arrays import FloatArray, IntArray

UPRIGHT = slice(4, 6)
"""Pitch and roll in a pose."""
UPRIGHT_SIGMA_RAD = 0.15
"""Deviation of pitch and roll of people who walk or run."""
USUAL_RAD = MappingProxyType({
    "root_pitch": (0.13, 0.26), "root_roll": (0.0, 0.6),
    "neck_turn": (0.0, 0.41), "neck_nod": (0.08, 0.34), "neck_tilt": (0.0, 0.15),
    "shoulder_abduction": (0.58, 1.25), "shoulder_flexion": (0.19, 0.73), "shoulder_twist": (-0.07, 1.26),
    "elbow_flexion": (0.99, 0.69), "hip_flexion": (0.44, 0.60), "hip_abduction": (0.07, 0.35),
    "hip_twist": (-0.06, 0.43), "knee_flexion": (0.62, 0.43),
})  # fmt: skip
"""Mean and deviation of a joint's angle, either side's, and of the root's lean. They differ from the neutral pose's
zeros where it matters to one camera: elbows and knees are bent, one way. Recorded people keep their roll within 0.14,
but not those who do anything else."""
UNKNOWN_RAD = (0.0, 1.0)
"""Mean and deviation of angles that are not listed, those of other skeletons."""
BALANCE_M, BALANCE_SIGMA_M = (0.043, 0.0), 0.05
"""How far ahead and to the left of the line between the ankles the centre of mass is: ± 0.046 and 0.040 m; in no
activity is the mean more than 0.05 m off."""
GROUND_SIGMA_M = 0.03
"""Deviation of the height of the lower ankle, which is 0.02 m in walks and 0.03 in runs."""

_LIMBS = (
    ("shoulder", "elbow", 0.028, 0.436),
    ("elbow", "wrist", 0.022, 0.682),
    ("hip", "knee", 0.100, 0.433),
    ("knee", "ankle", 0.061, 0.606),
)
"""Near and far joint, part of the body's mass and how far along its centre is, hands and feet included (Winter,
*Biomechanics and Motor Control of Human Movement*, 4th ed. 2009, table 4.1)."""


def views_residual(
    skeleton: Skeleton, seen: Sequence[Keypoints], sigma_px: float, upright: float = UPRIGHT_SIGMA_RAD
) -> ResidualFunction:
    """Measure how far joints are off one frame's keypoints in all views, with a deviation of sigma_px over the root of
    the weight, and how far the root leans, with the deviation `upright`, rad, see `upright_residual`."""
    views = [keypoint_residual(skeleton, view.camera, view.joints, view.marks, sigma_px) for view in seen]
    return stacked([*views, upright_residual(skeleton, upright)])


def joint_residual(skeleton: Skeleton, joints: IntArray, points: FloatArray, sigma_m: float) -> ResidualFunction:
    """Measure how far joints (K,) of the skeleton are off points (K, 3), m; 3 K residuals."""
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
    return lambda pose: (leaning @ pose, leaning)


def limit_residual(skeleton: Skeleton, sigma_rad: float) -> ResidualFunction:
    """Measure by how much angles are beyond the skeleton's limits; zero within."""
    low, high = skeleton.limits.T

    def residual(pose: FloatArray) -> tuple[FloatArray, FloatArray]:
        beyond = pose - np.clip(pose, low, high)
        return beyond / sigma_rad, np.diag(beyond != 0.0) / sigma_rad

    return residual


def posture_prior(skeleton: Skeleton) -> GaussianPrior:
    """Return independent normal joint angles, pitch and roll; the root may be anywhere and face anywhere."""
    sides = [name.removeprefix("left_").removeprefix("right_") for name in skeleton.dof_names]
    mean, deviation = np.array([USUAL_RAD.get(name, UNKNOWN_RAD) for name in sides]).T
    mean[: UPRIGHT.start], deviation[: UPRIGHT.start] = 0.0, np.inf
    return GaussianPrior.independent(mean, deviation)


def usual_residual(skeleton: Skeleton) -> ResidualFunction:
    """Measure how far joint angles, pitch and roll are off the usual ones."""
    usual = posture_prior(skeleton)
    own = usual.whitening[UPRIGHT.start :]
    return lambda pose: (own @ (pose - usual.mean), own)


def gaussian_residual(mean: FloatArray, precision: FloatArray) -> ResidualFunction:
    """Measure how far a pose is off N(mean (P,), precision⁻¹ (P, P)), which says nothing of numbers that have no
    precision."""
    own = np.flatnonzero(np.diagonal(precision))
    slopes = np.zeros((len(own), len(mean)))
    slopes[:, own] = np.linalg.cholesky(precision[np.ix_(own, own)]).T
    return lambda pose: (slopes @ (pose - mean), slopes)


def balance_residual(skeleton: Skeleton) -> ResidualFunction:
    """Measure how far the centre of mass is from a little ahead of the line between the ankles, where people have
    it."""
    masses, left, right = centre_of_mass(skeleton), skeleton.joint("left_ankle"), skeleton.joint("right_ankle")

    def residual(pose: FloatArray) -> tuple[FloatArray, FloatArray]:
        places = forward(skeleton, pose[None]).positions[0, :, :2]
        slopes = joint_jacobian(skeleton, pose[None])[0, :, :2]
        apart, d_apart = masses @ places - places[left], np.tensordot(masses, slopes, 1) - slopes[left]
        stance, d_stance = places[right] - places[left], slopes[right] - slopes[left]
        square = max(float(stance @ stance), 1e-9)
        part = float(apart @ stance) / square  # how far along the line between the ankles the nearest point is
        d_part = (stance @ d_apart + (apart - 2.0 * part * stance) @ d_stance) / square
        if not 0.0 < part < 1.0:
            part, d_part = min(max(part, 0.0), 1.0), np.zeros(len(pose))
        off, d_off = apart - part * stance, d_apart - part * d_stance - np.outer(stance, d_part)
        cos, sin = np.cos(pose[3]), np.sin(pose[3])
        ahead = np.array([[cos, sin], [-sin, cos]])  # the world's axes to those of the heading
        slope = ahead @ d_off
        slope[:, 3] += np.array([[-sin, cos], [-cos, -sin]]) @ off
        return (ahead @ off - BALANCE_M) / BALANCE_SIGMA_M, slope / BALANCE_SIGMA_M

    return residual


def ground_residual(skeleton: Skeleton, ground_m: float) -> ResidualFunction:
    """Measure how far the lower ankle's height, m, is off that of a standing person's ankles."""
    ankles = np.array([skeleton.joint("left_ankle"), skeleton.joint("right_ankle")])

    def residual(pose: FloatArray) -> tuple[FloatArray, FloatArray]:
        heights = forward(skeleton, pose[None]).positions[0, ankles, 2]
        lower = ankles[int(np.argmin(heights))]
        slope = joint_jacobian(skeleton, pose[None])[0, lower, 2:]
        return (heights.min(keepdims=True) - ground_m) / GROUND_SIGMA_M, slope / GROUND_SIGMA_M

    return residual


def centre_of_mass(skeleton: Skeleton) -> FloatArray:
    """Return weights (J,) of a person's joints that make their centre of mass; see _LIMBS. The trunk's is midway
    between pelvis and neck, a little high."""
    weights = dict.fromkeys(JOINT_NAMES, 0.0) | {"pelvis": 0.2485, "neck": 0.2485, "head_centre": 0.081}
    for side in ("left", "right"):
        for near, far, mass, along in _LIMBS:
            weights[f"{side}_{near}"] += mass * (1.0 - along)
            weights[f"{side}_{far}"] += mass * along
    total = sum(weights.values())
    return np.array([weights.get(name, 0.0) / total for name in skeleton.names])
