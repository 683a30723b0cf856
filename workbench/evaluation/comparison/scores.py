"""Errors of joints and of the angles between limbs, frame by frame."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from types import MappingProxyType

import numpy as np

from workbench.evaluation.errors.pose_errors import acceleration_error, procrustes
from workbench.evaluation.metrics import row_of
from workbench.evaluation.uncertainty.posterior_calibration import crps
from workbench.utils.arrays import FloatArray
from workbench.utils.nan_statistics import nan_mean

PCK_M = 0.15
"""Threshold of correct joints (Mehta et al., 3DV 2017), and the last one of the area under the curve."""
LEVELS = (0.05, 0.95)
SCORES: Mapping[str, tuple[str, str, int]] = MappingProxyType({
    "mpjpe": ("mean joint error", "mm", 1), "mpjpe_root": ("the same, pelvis aligned", "mm", 1),
    "pa_mpjpe": ("the same, Procrustes", "mm", 1), "pck_150": ("joints within 150 mm", "%", 1),
    "auc_150": ("area under the curve up to 150 mm", "%", 1),
    "acceleration": (row_of("acceleration_error_m_s2").title, "m/s²", 2),
    "missing": ("joints missing", "%", 1),
    "coverage_90": ("coordinates in the 90 % intervals", "%", 1), "crps": ("CRPS of coordinates", "mm", 1),
})  # fmt: skip
"""Title, unit and number of decimals of the scores, in the order of the table. Means are over the joints without the
pelvis, as of `pose_errors.step_errors`."""
_ANGLES = MappingProxyType({
    f"{side}_{parts[1]}": tuple(f"{side}_{part}" for part in parts)
    for side in ("left", "right") for parts in (("hip", "knee", "ankle"), ("shoulder", "elbow", "wrist"))
})  # fmt: skip
"""Angles of flexion, 0 where the limb is straight, by the three joints."""


@dataclass(frozen=True, eq=False)
class FrameScores:
    """Scores of F frames. scores: (F,) by name of SCORES, NaN where unknown. distances_mm: (F, J). angles_deg: by name,
    the estimated and true angles (F,)."""

    scores: Mapping[str, FloatArray]
    distances_mm: FloatArray
    angles_deg: Mapping[str, tuple[FloatArray, FloatArray]]


def frame_scores(
    names: Sequence[str], times_s: FloatArray, estimate: FloatArray, truth: FloatArray, samples: FloatArray
) -> FrameScores:
    """Return the scores of J named joints.

    Parameters
    ----------
    times_s : (F,), s, increasing.
    estimate, truth : (F, J, 3), m, aligned; NaN where missing.
    samples : (S, F, J, 3), m, of the estimate's posterior; S = 0 without one.
    """
    root = list(names).index("pelvis") if "pelvis" in names else None
    rows = [k for k in range(len(names)) if k != root]
    own, true = estimate[:, rows], truth[:, rows]
    distances = np.linalg.norm(own - true, axis=-1)
    is_true, known = np.isfinite(true).all(axis=-1), np.isfinite(distances)
    scores = {
        "mpjpe": 1e3 * nan_mean(distances),
        "pck_150": 100.0 * nan_mean(np.where(known, distances < PCK_M, np.nan)),
        "auc_150": 100.0 * nan_mean((1.0 - distances / PCK_M).clip(min=0.0)),
        "acceleration": np.pad(acceleration_error(own, true, times_s), 1, constant_values=np.nan)
        if len(times_s) > 2
        else np.full(len(times_s), np.nan),
        "missing": 100.0 * nan_mean(np.where(is_true, ~known, np.nan)),
        "pa_mpjpe": 1e3 * np.array([
            procrustes(a, np.where(np.isfinite(a), b, np.nan)) for a, b in zip(own, true, strict=True)
        ]),
    }  # fmt: skip
    if root is not None:
        relative = (own - estimate[:, root, None]) - (true - truth[:, root, None])
        scores["mpjpe_root"] = 1e3 * nan_mean(np.linalg.norm(relative, axis=-1))
    if len(samples):
        scores |= _calibration(samples[:, :, rows], true)
    everywhere = 1e3 * np.linalg.norm(estimate - truth, axis=-1)
    own_angles, true_angles = joint_angles(names, estimate), joint_angles(names, truth)
    return FrameScores(scores, everywhere, {name: (own_angles[name], true_angles[name]) for name in own_angles})


def _calibration(samples: FloatArray, truth: FloatArray) -> dict[str, FloatArray]:
    """Return coverage and continuous ranked probability score (F,) of samples (S, F, J, 3) for the truth (F, J, 3)."""
    known = np.isfinite(truth) & np.isfinite(samples).all(axis=0)
    low, high = np.quantile(np.where(known, samples, 0.0), LEVELS, axis=0)
    score = np.full(truth.shape, np.nan)
    weights = np.full(len(samples), 1.0 / len(samples))
    score[known] = crps(np.ascontiguousarray(samples[:, known]), weights, truth[known])
    inside = np.where(known, (low <= truth) & (truth <= high), np.nan)
    return {"coverage_90": 100.0 * nan_mean(inside.reshape(len(truth), -1)),
            "crps": 1e3 * nan_mean(score.reshape(len(truth), -1))}  # fmt: skip


def joint_angles(names: Sequence[str], positions: FloatArray) -> dict[str, FloatArray]:
    """Return the flexion (F,), degrees, of knees and elbows, by name, of named joints (F, J, 3)."""
    index = {name: k for k, name in enumerate(names)}
    return {
        angle: _flexion_deg(positions[:, [index[joint] for joint in joints]])
        for angle, joints in _ANGLES.items()
        if set(joints) <= set(index)
    }


def _flexion_deg(joints: FloatArray) -> FloatArray:
    """Return the flexion (F,), degrees, 0 if straight, of limbs that meet in the second of three joints (F, 3, 3)."""
    upper, lower = joints[:, 1] - joints[:, 0], joints[:, 2] - joints[:, 1]
    across = np.linalg.norm(np.cross(upper, lower), axis=-1)
    return np.asarray(np.degrees(np.arctan2(across, (upper * lower).sum(axis=-1))))
