"""How much a posterior doubts itself, joint group by joint group: what says "do not trust this" without any truth; and
how well that tells where it is wrong."""

import numpy as np
import scipy

from workbench.body.kinematics import joints
from workbench.body.skeleton import Skeleton
from workbench.core.step import Step
from workbench.evaluation.step_calibration import GROUPS
from workbench.utils.arrays import BoolArray, FloatArray, IntArray

LARGE_MM = 50.0
"""An error that a person wants to be warned of."""
MOST = 500
"""Particles that doubts are told from."""


def joint_groups(skeleton: Skeleton) -> dict[str, IntArray]:
    """Name the joints of the groups of `step_calibration.GROUPS`; the root is the first joint."""
    found = {
        group: np.array([k for k, name in enumerate(skeleton.names) if any(word in name for word in words)])
        for group, words in GROUPS.items()
    }
    found["root"] = np.array([0])
    return {group: own.astype(np.int64) for group, own in found.items() if len(own)}


def stated_doubt(step: Step, skeleton: Skeleton) -> dict[str, float]:
    """Return doubt_<group>_mm: the mean distance, by weight, of the particles' joints from where they are expected.

    It is what the posterior itself says the mean joint error of the group is, and knows of no truth. Of more than MOST
    particles as many stand for all, at evenly spaced ranks of their weights.
    """
    poses, weights = step.poses, np.exp(step.log_weights)
    if len(poses) > MOST:
        ranks = (np.arange(MOST) + 0.5) / MOST * weights.sum()
        rows = np.searchsorted(np.cumsum(weights), ranks).clip(max=len(poses) - 1)
        poses, weights = poses[rows], np.full(MOST, 1.0 / MOST)
    expected = joints(skeleton, step.expected_pose[None])[0]
    away = 1e3 * (weights @ np.linalg.norm(joints(skeleton, poses) - expected, axis=2))
    return {f"doubt_{group}_mm": float(away[own].mean()) for group, own in joint_groups(skeleton).items()}


def group_errors(step: Step, skeleton: Skeleton) -> dict[str, float]:
    """Return missed_<group>_mm: the mean distance of the expected pose's joints from the true ones, where known."""
    truth = step.frame.truth
    if truth is None or truth.joints is None:
        return {}
    away = 1e3 * np.linalg.norm(joints(skeleton, step.expected_pose[None])[0] - truth.joints, axis=1)
    known = {group: own[np.isfinite(away[own])] for group, own in joint_groups(skeleton).items()}
    return {f"missed_{group}_mm": float(away[own].mean()) for group, own in known.items() if len(own)}


def spearman(stated: FloatArray, errors: FloatArray) -> float:
    """Return the correlation of the ranks of two series (n,), Spearman's; NaN where one does not vary."""
    if len(stated) < 2 or min(np.ptp(stated), np.ptp(errors)) == 0.0:
        return float("nan")
    return float(scipy.stats.spearmanr(stated, errors).statistic)


def area_under_curve(stated: FloatArray, wrong: BoolArray) -> float:
    """Return the probability that what is wrong (n,) is doubted more than what is not, ties counted half: the area
    under the receiver operating characteristic (Hanley & McNeil 1982); NaN where all are alike."""
    n_wrong = int(wrong.sum())
    n_right = len(wrong) - n_wrong
    if not (n_wrong and n_right):
        return float("nan")
    rank_sum = float(scipy.stats.rankdata(stated)[wrong].sum())
    return (rank_sum - 0.5 * n_wrong * (n_wrong + 1)) / (n_wrong * n_right)
