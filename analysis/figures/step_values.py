"""Values of a step for claims and tables that are not among its errors."""

import numpy as np

from workbench.body.angles import flexions
from workbench.body.kinematics import forward
from workbench.body.skeleton import JOINT_NAMES, Skeleton
from workbench.cameras.camera import Camera
from workbench.core.step import Step
from workbench.evaluation.errors.pose_errors import geodesic_deg
from workbench.evaluation.uncertainty.intervals import weighted_quantiles
from workbench.evaluation.uncertainty.step_calibration import GROUPS
from workbench.utils.arrays import FloatArray

TWIST = "right_shoulder_twist"
MIN_DEPTH_M = 0.08
LIMBS = tuple(
    (JOINT_NAMES.index(f"{side}_{upper}"), JOINT_NAMES.index(f"{side}_{lower}"))
    for side in ("left", "right")
    for upper, lower in (("shoulder", "elbow"), ("elbow", "wrist"), ("hip", "knee"), ("knee", "ankle"))
)


def step_values(step: Step, skeleton: Skeleton) -> dict[str, float]:
    """Return hip_difference_deg, the flexion of the left hip minus that of the right, and the values of the truth that
    is known: `pose_values` and `joint_values`."""
    values, truth, estimated = {}, step.frame.truth, flexions(skeleton, step.expected_pose)
    if "left_hip" in estimated:
        values["hip_difference_deg"] = estimated["left_hip"] - estimated["right_hip"]
    if truth is not None and truth.pose is not None:
        values |= pose_values(step, skeleton, truth.pose)
    if truth is not None and truth.joints is not None:
        values |= joint_values(step, skeleton, truth.joints)
    return values


def pose_values(step: Step, skeleton: Skeleton, truth: FloatArray) -> dict[str, float]:
    """Return values by the true pose (P,).

    root_rotation_deg: angle between the estimated and the true rotation of the root. highest_knee_deg: the larger true
    flexion of the knees. twist_width_deg, twist_covered: width of the 90 % credible interval of TWIST, and whether it
    contains the truth.
    """
    rotations = forward(skeleton, np.stack([step.expected_pose, truth])).rotations[:, 0]
    values, true = {"root_rotation_deg": float(geodesic_deg(*rotations))}, flexions(skeleton, truth)
    if "left_knee" in true:
        values["highest_knee_deg"] = max(true["left_knee"], true["right_knee"])
    if TWIST in skeleton.dof_names and step.spread[k := skeleton.dof(TWIST)]:
        low, high = weighted_quantiles(step.poses[:, [k]], np.exp(step.log_weights), (0.05, 0.95))[:, 0]
        values["twist_width_deg"] = float(np.degrees(high - low))
        values["twist_covered"] = float(low <= truth[k] <= high)
    return values


def joint_values(step: Step, skeleton: Skeleton, truth: FloatArray) -> dict[str, float]:
    """Return values by the true joints (J, 3), m: the root-aligned errors mpjpe_arms_mm and mpjpe_legs_mm, and with a
    camera n_deep_limbs and n_wrong_signs, see `wrong_signs`."""
    estimate, values = step.expected_joints(skeleton), {}
    distances = 1e3 * np.linalg.norm(estimate - estimate[0] - (truth - truth[0]), axis=1)
    for group in ("arms", "legs"):
        inside = [k for k, name in enumerate(skeleton.names) if any(word in name for word in GROUPS[group])]
        values[f"mpjpe_{group}_mm"] = float(np.mean(distances[inside]))
    if step.frame.views and skeleton.names == JOINT_NAMES:
        signs = wrong_signs(step.frame.views[0].camera, estimate, truth)
        values |= {"n_deep_limbs": float(len(signs)), "n_wrong_signs": float(sum(signs))}
    return values


def wrong_signs(camera: Camera, estimate: FloatArray, truth: FloatArray) -> list[bool]:
    """Return, for the limbs over MIN_DEPTH_M in depth among true joints (J, 3), m, whether the estimate (J, 3) has the
    other sign."""

    def depths(places: FloatArray) -> FloatArray:
        first, last = places[list(LIMBS)].swapaxes(0, 1)
        rays = first - camera.position
        return np.asarray(((last - first) * rays).sum(axis=1) / np.linalg.norm(rays, axis=1))

    true, estimated = depths(truth), depths(estimate)
    return list(np.asarray(true * estimated < 0.0)[np.abs(true) > MIN_DEPTH_M])
