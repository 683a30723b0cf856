"""One step's posterior against the truth: coverage, ranks, proper scores, and the error that it states of itself."""

from collections.abc import Sequence
from functools import lru_cache
from weakref import WeakKeyDictionary

import numpy as np
import scipy

from workbench.body.angles import N_POSITION, unwrap_near
from workbench.body.kinematics import joints
from workbench.body.skeleton import Skeleton
from workbench.core.step import Step
from workbench.evaluation.posterior_calibration import covered, crps, log_score, moments, ranks, share_below
from workbench.utils.arrays import BoolArray, FloatArray, IntArray

_LEVELS = (0.5, 0.9)
"""Of the central bands whose coverage is counted."""
_GIVEN = 1e-9
"""m or rad: a number that all particles share and that is as near as this to the truth was given."""
_RANKS: WeakKeyDictionary[Step, FloatArray] = WeakKeyDictionary()
"""Of the steps that there are, by their frames' truth."""
LARGE_MM = 50.0
"""An error that a person wants to be warned of."""
_MAX_PARTICLES = 500
"""Particles from which expected errors are computed."""
GROUPS = {
    "root": ("root",),
    "head": ("neck", "head"),
    "arms": ("shoulder", "elbow", "wrist"),
    "legs": ("hip", "knee", "ankle"),
}
"""Words of the names of angles and joints that belong together."""


def pose_calibration(step: Step, skeleton: Skeleton) -> dict[str, float]:
    """Return coverage_50, coverage_90, crps_mm, crps_deg, z2 and log_score over the numbers of the true pose; raises
    ValueError where the step's frame knows none.

    Those in which all particles equal the truth are not counted: they are given. Those in which all particles are equal
    and wrong are missed; they have no z2, the mean of (truth − mean)² / variance, and no log_score. crps_mm is of the
    root's position, crps_deg of all angles, which are compared on the turn of the expected pose. coverage_90 is also
    reported by group of GROUPS. Only coverage_90 is there, NaN, where nothing is counted.
    """
    values, weights, true, counted = _compared(step)
    shares = share_below(values, weights, true)
    _RANKS[step] = ranks(shares)
    if not counted.any():
        return {"coverage_90": float("nan")}
    scores, n_lengths = crps(values, weights, true), int(counted[:N_POSITION].sum())
    names = [name for name, is_counted in zip(skeleton.dof_names, counted, strict=True) if is_counted]
    scored = {"crps_mm": 1e3 * scores[:n_lengths], "crps_deg": np.degrees(scores[n_lengths:])}
    spread = step.spread[counted]
    if spread.any():
        mean, variance = (each[spread] for each in moments(values, weights))
        with np.errstate(divide="ignore", invalid="ignore"):
            scored["z2"] = (true[spread] - mean) ** 2 / variance
        scored["log_score"] = log_score(mean, variance, true[spread])
    means = {name: float(each.mean()) for name, each in scored.items() if len(each)}
    finite = {name: mean for name, mean in means.items() if np.isfinite(mean)}  # one particle has all the weight
    return _coverages(shares, names, "") | finite


def pose_ranks(step: Step) -> FloatArray:
    """Return the ranks, in 0..1, of the true pose's numbers that `pose_calibration` counts; none if unknown."""
    if step not in _RANKS:
        truth = step.frame.truth
        if truth is None or truth.pose is None:
            return np.zeros(0)
        values, weights, true, _ = _compared(step)
        _RANKS[step] = ranks(share_below(values, weights, true))
    return _RANKS[step]


def joint_calibration(step: Step, skeleton: Skeleton, truth: FloatArray, measured: Sequence[int]) -> dict[str, float]:
    """Return coverage_50_joints, coverage_90_joints and crps_joints_mm over the coordinates of those of the true joints
    (J, 3), m, that are measured and known; coverage_90_joints also by group of GROUPS."""
    known = [joint for joint in measured if np.isfinite(truth[joint]).all()]
    if not known:
        return {}
    values = joints(skeleton, step.poses)[:, known].reshape(len(step.poses), -1)
    weights, true = np.exp(step.log_weights), truth[known].ravel()
    names = [skeleton.names[joint] for joint in known for _ in range(3)]
    score = 1e3 * float(crps(values, weights, true).mean())
    return {**_coverages(share_below(values, weights, true), names, "_joints"), "crps_joints_mm": score}


def _compared(step: Step) -> tuple[FloatArray, FloatArray, FloatArray, BoolArray]:
    """Select the numbers that are counted (P,): of the poses (N, D), their weights (N,) and of the true pose (D,)."""
    if step.frame.truth is None or step.frame.truth.pose is None:
        raise ValueError(f"frame {step.frame.index}: expected a true pose to compare with, found none")
    poses, true = (unwrap_near(each, step.expected_pose) for each in (step.poses, step.frame.truth.pose))
    counted = step.spread | (np.abs(true - poses[0]) > _GIVEN)
    return poses.T[counted].T, np.exp(step.log_weights), true[counted], counted  # of which columns lie in one piece


def _coverages(shares: FloatArray, names: Sequence[str], suffix: str) -> dict[str, float]:
    """Of what lies below the truth and equals it, (2, D) of the numbers called `names`: shares of them within the bands
    of _LEVELS, and within the widest by group."""
    inside = covered(shares, _LEVELS)
    rates = {f"coverage_{100.0 * level:.0f}{suffix}": row.mean() for level, row in zip(_LEVELS, inside, strict=True)}
    for group, belongs in _members(tuple(names)).items():
        if belongs.any():
            rates[f"coverage_90{suffix}_{group}"] = inside[-1, belongs].mean()
    return {name: float(share) for name, share in rates.items()}


@lru_cache
def _members(names: tuple[str, ...]) -> dict[str, BoolArray]:
    """Return by group of GROUPS which of the names belong to it, (D,)."""
    return {g: np.array([any(word in name for word in words) for name in names]) for g, words in GROUPS.items()}


@lru_cache
def _joint_groups(skeleton: Skeleton) -> dict[str, IntArray]:
    """Name the joints of the groups of `step_calibration.GROUPS`; the root is the first joint."""
    own = {g: [k for k, n in enumerate(skeleton.names) if any(w in n for w in words)] for g, words in GROUPS.items()}
    return {group: np.array(those, np.int64) for group, those in (own | {"root": [0]}).items() if those}


def stated_doubt(step: Step, skeleton: Skeleton) -> dict[str, float]:
    """Return doubt_<group>_mm: the mean distance, by weight, of the particles' joints from where they are expected.

    It is the mean joint error of the group that the posterior states. More than _MAX_PARTICLES particles are
    represented by as many at evenly spaced ranks of their weights.
    """
    poses, weights = step.poses, np.exp(step.log_weights)
    if len(poses) > _MAX_PARTICLES:
        ranks = (np.arange(_MAX_PARTICLES) + 0.5) / _MAX_PARTICLES * weights.sum()
        rows = np.searchsorted(np.cumsum(weights), ranks).clip(max=len(poses) - 1)
        poses, weights = poses[rows], np.full(_MAX_PARTICLES, 1.0 / _MAX_PARTICLES)
    expected = joints(skeleton, step.expected_pose[None])[0]
    away = 1e3 * (weights @ np.linalg.norm(joints(skeleton, poses) - expected, axis=2))
    return {f"doubt_{group}_mm": float(away[own].mean()) for group, own in _joint_groups(skeleton).items()}


def group_errors(step: Step, skeleton: Skeleton) -> dict[str, float]:
    """Return missed_<group>_mm: the mean distance of the expected pose's joints from the true ones, where known."""
    truth = step.frame.truth
    if truth is None or truth.joints is None:
        return {}
    away = 1e3 * np.linalg.norm(joints(skeleton, step.expected_pose[None])[0] - truth.joints, axis=1)
    known = {group: own[np.isfinite(away[own])] for group, own in _joint_groups(skeleton).items()}
    return {f"missed_{group}_mm": float(away[own].mean()) for group, own in known.items() if len(own)}


def spearman(stated: FloatArray, errors: FloatArray) -> float:
    """Return the correlation of the ranks of two series (n,), Spearman's; NaN where one does not vary."""
    if len(stated) < 2 or min(np.ptp(stated), np.ptp(errors)) == 0.0:
        return float("nan")
    return float(scipy.stats.spearmanr(stated, errors).statistic)


def area_under_curve(stated: FloatArray, wrong: BoolArray) -> float:
    """Return the probability that the stated error of what is wrong (n,) exceeds that of what is not, ties counted
    half: the area under the receiver operating characteristic (Hanley & McNeil 1982); NaN where all are alike."""
    if wrong.all() or not wrong.any():
        return float("nan")
    return float(scipy.stats.mannwhitneyu(stated[wrong], stated[~wrong]).statistic / (wrong.sum() * (~wrong).sum()))
