"""Agreement of the estimated directions of torso and knees with those of a detector's world landmarks.

A detector sees by face, clothes and feet what the joints of a single image do not determine: whether a person faces the
camera, and whether a leg is foreshortened because the knee is bent. Landmarks of one image are wrong for some frames;
over half a second and more either they or the estimate are wrong.
"""

import numpy as np

from workbench.body.skeleton import joint_of
from workbench.body.stature import SIDES
from workbench.evaluation.verdict.run_measurements import RunMeasurements
from workbench.utils.arrays import FloatArray
from workbench.utils.nan_statistics import nan_median

MAX_FACING_DEG = 60.0
"""Angle between two directions of a torso: four standard deviations of a detector's, which are 10 to 15 degrees."""
MAX_KNEE_DEG = 45.0
"""Difference of a knee's flexions: three standard deviations of a detector's, 15 degrees in walking people."""


def facing_deg(measured: RunMeasurements) -> FloatArray:
    """Return the angle (F,) between the directions in which the estimated torso and the landmarks' face, the median
    over views; NaN without landmarks."""
    estimated, observed = _forward(measured.estimated_joints)[:, None], _forward(measured.world_landmarks)
    return nan_median(np.degrees(np.arccos((estimated * observed).sum(axis=-1).clip(-1.0, 1.0))), axis=1)


def knee_differences_deg(measured: RunMeasurements) -> FloatArray:
    """Return by how much the estimated left and right knees are less flexed than the landmarks', (F, 2), the median
    over views; NaN without landmarks."""
    estimated, observed = _knee_angles(measured.estimated_joints)[:, None], _knee_angles(measured.world_landmarks)
    return nan_median(np.degrees(estimated - observed), axis=1)


def _forward(joints: FloatArray) -> FloatArray:
    """Return the unit direction (..., 3) in which the torso of joints (..., J, 3) faces, by shoulders and hips."""
    left_shoulder, right_shoulder, left_hip, right_hip = (
        joint_of(joints, f"{side}_{name}") for name in ("shoulder", "hip") for side in SIDES
    )
    to_left = left_shoulder - right_shoulder + left_hip - right_hip
    forward = np.cross(to_left, left_shoulder + right_shoulder - left_hip - right_hip)
    return np.asarray(forward / np.maximum(np.linalg.norm(forward, axis=-1, keepdims=True), 1e-12))


def _knee_angles(joints: FloatArray) -> FloatArray:
    """Return the angles (..., 2) between thigh and shank of the joints (..., J, 3), π of a straight leg."""
    angles = []
    for side in SIDES:
        hip, knee, ankle = (joint_of(joints, f"{side}_{name}") for name in ("hip", "knee", "ankle"))
        thigh, shank = hip - knee, ankle - knee
        lengths = np.linalg.norm(thigh, axis=-1) * np.linalg.norm(shank, axis=-1)
        angles.append(np.arccos(((thigh * shank).sum(axis=-1) / np.maximum(lengths, 1e-12)).clip(-1.0, 1.0)))
    return np.stack(angles, axis=-1)
