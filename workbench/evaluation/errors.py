"""How far an estimate is from the truth, frame by frame."""

import numpy as np

from workbench.arrays import FloatArray
from workbench.body.camera import Camera
from workbench.body.kinematics import joints
from workbench.body.skeleton import ERROR_JOINTS, Skeleton
from workbench.datasets.frame import Truth
from workbench.evaluation.posterior import weighted_quantiles
from workbench.inference.step import Step

BAND = (0.05, 0.95)
"""The 90 % band whose coverage is counted."""


def step_errors(step: Step, skeleton: Skeleton, image_scale: float = 1.0) -> dict[str, float]:
    """The errors of one step that its truth allows, of the expected pose and (`_map`) of the heaviest particle.

    error_abs_mm: mean distance of the 14 joints (all but the pelvis). error_rel_mm: the same after moving pelvis onto
    pelvis. error_px: mean distance in the first view's image, in pixels of the unscaled image (`image_scale` is the
    factor the image was resized by); where joints were marked by hand, over the visible marks. coverage_90: fraction of
    the pose's numbers whose truth lies in the posterior's 5–95 % band. Nothing is returned without truth.
    """
    truth = step.frame.truth
    if truth is None:
        return {}
    estimates = joints(skeleton, np.stack([step.expected_pose, step.map_pose]))
    errors: dict[str, float] = {}
    for suffix, estimate in zip(("", "_map"), estimates, strict=True):
        if truth.joints is not None:
            errors |= {name + suffix: value for name, value in joint_errors(skeleton, estimate, truth.joints).items()}
        pixels = _pixel_error(step.frame.views[0].camera, skeleton, estimate, truth) if step.frame.views else None
        if pixels is not None:
            errors[f"error_px{suffix}"] = pixels / image_scale
    if truth.pose is not None:
        errors["coverage_90"] = _coverage(step, truth.pose)
    return errors


def joint_errors(skeleton: Skeleton, estimate: FloatArray, truth: FloatArray) -> dict[str, float]:
    """error_abs_mm and error_rel_mm of joints (J, 3), m, against true joints (J, 3), m."""
    measured = [skeleton.joint(name) for name in ERROR_JOINTS]
    apart = estimate - truth
    return {
        "error_abs_mm": 1e3 * float(np.linalg.norm(apart[measured], axis=1).mean()),
        "error_rel_mm": 1e3 * float(np.linalg.norm(apart[measured] - apart[0], axis=1).mean()),
    }


def _pixel_error(camera: Camera, skeleton: Skeleton, estimate: FloatArray, truth: Truth) -> float | None:
    measured = [skeleton.joint(name) for name in ERROR_JOINTS]
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
    return float(np.linalg.norm(seen - camera.project(truth.joints), axis=1)[measured].mean())


def _coverage(step: Step, pose: FloatArray) -> float:
    """Numbers the prior holds fixed (no spread among the particles) are left out."""
    spread = np.ptp(step.poses, axis=0) > 0.0
    if not spread.any():
        return float("nan")
    low, high = weighted_quantiles(step.poses[:, spread], np.exp(step.log_weights), BAND)
    return float(((low <= pose[spread]) & (pose[spread] <= high)).mean())
