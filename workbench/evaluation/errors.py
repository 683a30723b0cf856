"""How far an estimate is from the truth, frame by frame."""

from collections.abc import Sequence

import numpy as np

from workbench.arrays import FloatArray
from workbench.body.camera import Camera
from workbench.body.flexion import flexions, wrapped_deg
from workbench.body.kinematics import joints
from workbench.body.limbs import Body
from workbench.body.skeleton import POSE_NAMES, Skeleton
from workbench.datasets.frame import Truth
from workbench.evaluation.posterior import weighted_quantiles
from workbench.inference.step import Step

BAND = (0.05, 0.95)
"""The 90 % band whose coverage is counted."""


def step_errors(
    step: Step, body: Body, moving: Sequence[str] = POSE_NAMES, image_scale: float = 1.0
) -> dict[str, float]:
    """The errors of one step that its truth allows, of the expected pose and (`_map`) of the heaviest particle.

    The mean is over the joints that the parameters `moving`, those the prior moves, can move, but the root, which is 14
    of the person's: for a tracked arm elbow and wrist. error_abs_mm: their mean distance. error_rel_mm: the same after
    moving pelvis onto pelvis. error_px: mean distance in the first view's image, in pixels of the unscaled image
    (`image_scale` is the factor the image was resized by); where joints were marked by hand, over the visible marks.
    forearm_px: width of a forearm in the same pixels, the yardstick of `held`, where the true joints are known.
    coverage_90: fraction of the pose's numbers whose truth lies in the posterior's 5–95 % band. knee_deg, hip_deg: see
    `flexion_errors`. activity_accuracy: 1 where the activity told is the true one. Nothing is returned without truth.
    """
    truth = step.frame.truth
    if truth is None:
        return {}
    skeleton = body.skeleton
    measured = moved_joints(skeleton, moving)
    estimates = joints(skeleton, np.stack([step.expected_pose, step.map_pose]))
    errors: dict[str, float] = {}
    for suffix, estimate in zip(("", "_map"), estimates, strict=True):
        if truth.joints is not None:
            errors |= {name + suffix: value for name, value in joint_errors(measured, estimate, truth.joints).items()}
        pixels = _pixel_error(step.frame.views[0].camera, measured, estimate, truth) if step.frame.views else None
        if pixels is not None:
            errors[f"error_px{suffix}"] = pixels / image_scale
    if truth.joints is not None and step.frame.views:
        errors["forearm_px"] = forearm_px(step.frame.views[0].camera, body, truth.joints, measured) / image_scale
    if truth.pose is not None:
        errors["coverage_90"] = _coverage(step, truth.pose)
        errors |= flexion_errors(skeleton, step.expected_pose, truth.pose)
    if truth.activity is not None and step.activity is not None:
        errors["activity_accuracy"] = float(step.activity == truth.activity)
    return errors


def flexion_errors(skeleton: Skeleton, pose: FloatArray, truth: FloatArray) -> dict[str, float]:
    """knee_deg and hip_deg: root mean square error of the flexion of both legs, degrees, where the skeleton has it.

    Whole turns are no error: where nothing keeps an angle within its limits, a fit may end a turn away.
    """
    found, true, errors = flexions(skeleton, pose), flexions(skeleton, truth), {}
    for joint in ("knee", "hip"):
        apart = [wrapped_deg(found[name] - true[name]) for name in found if name.endswith(joint)]
        if apart:
            errors[f"{joint}_deg"] = float(np.sqrt(np.mean(np.square(apart))))
    return errors


def held(error_px: Sequence[float], forearm_px: Sequence[float], last: int = 5) -> bool:
    """Whether a run of frames ends on the person: mean error over the last frames below a forearm's width, px."""
    return float(np.mean(error_px[-last:])) < float(np.mean(forearm_px[-last:]))


def moved_joints(skeleton: Skeleton, moving: Sequence[str]) -> list[int]:
    """The joints, but the root, that one of the parameters called `moving` moves: those below the one it turns."""
    turned = {int(skeleton.dof_joints[skeleton.dof(name)]) for name in moving}
    translated = any(skeleton.dof(name) < 3 for name in moving)

    def moves(joint: int) -> bool:
        above = int(skeleton.parents[joint])
        return translated or (above >= 0 and (above in turned or moves(above)))

    return [joint for joint in range(1, len(skeleton.names)) if moves(joint)]


def forearm_px(camera: Camera, body: Body, true_joints: FloatArray, measured: Sequence[int]) -> float:
    """Mean width of the forearm in the image, px, seen at the mean depth of the measured joints (J, 3)."""
    width_m = float(np.sum(body.shape.forearm_radii))  # the mean of the two ends' diameters
    depth_m = float(camera.to_camera(true_joints)[list(measured), 2].mean())
    return float(camera.matrix[0, 0]) * width_m / depth_m


def joint_errors(measured: Sequence[int], estimate: FloatArray, truth: FloatArray) -> dict[str, float]:
    """error_abs_mm and error_rel_mm of joints (J, 3), m, against true joints (J, 3), m, over those measured."""
    apart = estimate - truth
    return {
        "error_abs_mm": 1e3 * float(np.linalg.norm(apart[list(measured)], axis=1).mean()),
        "error_rel_mm": 1e3 * float(np.linalg.norm(apart[list(measured)] - apart[0], axis=1).mean()),
    }


def _pixel_error(camera: Camera, measured: Sequence[int], estimate: FloatArray, truth: Truth) -> float | None:
    seen = camera.project(estimate)
    if truth.marks is not None:
        visible = np.isfinite(truth.marks).all(axis=1)
        if truth.marks_visible is not None:
            visible &= truth.marks_visible
        if not visible.any():
            return None
        return float(np.linalg.norm(seen - truth.marks, axis=1)[visible].mean())
    if truth.joints is None:
        return None
    return float(np.linalg.norm(seen - camera.project(truth.joints), axis=1)[list(measured)].mean())


def _coverage(step: Step, pose: FloatArray) -> float:
    """Numbers the prior holds fixed (no spread among the particles) are left out."""
    spread = np.ptp(step.poses, axis=0) > 0.0
    if not spread.any():
        return float("nan")
    low, high = weighted_quantiles(step.poses[:, spread], np.exp(step.log_weights), BAND)
    return float(((low <= pose[spread]) & (pose[spread] <= high)).mean())
