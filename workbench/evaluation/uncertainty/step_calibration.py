"""Calibration of one step's posterior: coverage, ranks, proper scores, and expected errors."""

from collections.abc import Sequence
from functools import lru_cache
from weakref import WeakKeyDictionary

import numpy as np
import scipy

from workbench.body.angles import N_POSITION, unwrap_near
from workbench.body.kinematics import joints
from workbench.body.skeleton import Skeleton
from workbench.core.step import Step
from workbench.evaluation.uncertainty.posterior_calibration import (
    covered,
    crps,
    gaussian_nll,
    moments,
    ranks,
    weight_below,
)
from workbench.utils.arrays import BoolArray, FloatArray, IntArray

_LEVELS = {"coverage_50": 0.5, "coverage_90": 0.9}
"""Levels of the central credible intervals whose coverage is measured; that of the last also by group."""
_FIXED_TOLERANCE = 1e-9
"""m or rad: a parameter as near as this to another value counts as equal to it."""
_RANKS: WeakKeyDictionary[Step, FloatArray] = WeakKeyDictionary()
"""Ranks of the true pose's parameters by step."""
LARGE_MM = 50.0
"""Expected error from which on a group of joints is marked as uncertain."""
_MAX_PARTICLES = 500
"""Largest number of particles from which expected errors are computed."""
GROUPS = {
    "root": ("root",),
    "head": ("neck", "head"),
    "arms": ("shoulder", "elbow", "wrist"),
    "legs": ("hip", "knee", "ankle"),
}
"""Groups of angles and joints, by words in their names."""


def given_parameters(skeleton: Skeleton, moving: Sequence[str], truth: FloatArray, initial: FloatArray) -> BoolArray:
    """Select (P,), the parameters that are inputs: not in `moving`, with a true value that is still the initial one.

    Their error is that of the given initial pose. A parameter that is not in `moving` but whose true value changes is
    not selected: the posterior is wrong about it.

    Parameters
    ----------
    moving : the parameters that the prior moves.
    truth, initial : (P,) the true pose in this frame and in the first frame.
    """
    fixed = np.array([name not in moving for name in skeleton.dof_names])
    return fixed & (np.abs(truth - initial) <= _FIXED_TOLERANCE)


def pose_calibration(step: Step, skeleton: Skeleton, given: BoolArray | None = None) -> dict[str, float]:
    """Return coverage_50, coverage_90, crps_mm, crps_deg, nees_per_dim and nll over the parameters of the true pose.

    coverage_90 is also returned by group of GROUPS. crps_mm is of the root's position, crps_deg of all angles, taken on
    the same turn as the expected pose's. nees_per_dim is the mean of (truth − mean)² / variance of the single
    parameters, 1 if calibrated. nll is the mean of their `gaussian_nll`.

    Parameters in which all particles are equal are excluded where they equal the truth or are given. Where they are
    neither, the parameter is not covered, and has no nees_per_dim and nll. Without any parameter the result is
    coverage_90, NaN.

    Parameters
    ----------
    given : (P,) see `given_parameters`; None: no parameter is given.

    Raises
    ------
    ValueError : the step's frame has no true pose.
    """
    values, weights, true, included = _compared(step, given)
    below = weight_below(values, weights, true)
    _RANKS[step] = ranks(below)
    if not included.any():
        return {"coverage_90": float("nan")}
    scores, n_lengths = crps(values, weights, true), int(included[:N_POSITION].sum())
    names = [name for name, is_included in zip(skeleton.dof_names, included, strict=True) if is_included]
    scored = {"crps_mm": 1e3 * scores[:n_lengths], "crps_deg": np.degrees(scores[n_lengths:])}
    spread = step.spread[included]
    if spread.any():
        mean, variance = (each[spread] for each in moments(values, weights))
        with np.errstate(divide="ignore", invalid="ignore"):
            scored["nees_per_dim"] = (true[spread] - mean) ** 2 / variance
        scored["nll"] = gaussian_nll(mean, variance, true[spread])
    means = {name: float(each.mean()) for name, each in scored.items() if len(each)}
    finite = {name: mean for name, mean in means.items() if np.isfinite(mean)}  # one particle has all the weight
    return _coverages(below, names, "") | finite


def pose_ranks(step: Step) -> FloatArray:
    """Return the ranks (k,), in 0..1, of the true pose's parameters; k = 0 without a true pose.

    The parameters are those of the step's last `pose_calibration`; before the first one, no parameter is given.
    """
    if step not in _RANKS:
        truth = step.frame.truth
        if truth is None or truth.pose is None:
            return np.zeros(0)
        values, weights, true, _ = _compared(step, None)
        _RANKS[step] = ranks(weight_below(values, weights, true))
    return _RANKS[step]


def joint_calibration(step: Step, skeleton: Skeleton, truth: FloatArray, measured: Sequence[int]) -> dict[str, float]:
    """Return coverage_50_joints, coverage_90_joints and crps_joints_mm over the coordinates of true joints (J, 3), m.

    They include the measured joints that are not NaN. coverage_90_joints is also returned by group of GROUPS.
    """
    valid = [joint for joint in measured if np.isfinite(truth[joint]).all()]
    if not valid:
        return {}
    values = joints(skeleton, step.poses)[:, valid].reshape(len(step.poses), -1)
    weights, true = np.exp(step.log_weights), truth[valid].ravel()
    names = [skeleton.names[joint] for joint in valid for _ in range(3)]
    score = 1e3 * float(crps(values, weights, true).mean())
    return {**_coverages(weight_below(values, weights, true), names, "_joints"), "crps_joints_mm": score}


def _compared(step: Step, given: BoolArray | None) -> tuple[FloatArray, FloatArray, FloatArray, BoolArray]:
    """Return poses (N, D), weights (N,), the true pose (D,), and which parameters (P,) of a pose are included."""
    if step.frame.truth is None or step.frame.truth.pose is None:
        raise ValueError(f"frame {step.frame.index}: expected a true pose to compare with, found none")
    poses, true = (unwrap_near(each, step.expected_pose) for each in (step.poses, step.frame.truth.pose))
    wrong = np.abs(true - poses[0]) > _FIXED_TOLERANCE
    included = step.spread | (wrong if given is None else wrong & ~given)
    return poses.T[included].T, np.exp(step.log_weights), true[included], included  # contiguous columns


def _coverages(below: FloatArray, names: Sequence[str], suffix: str) -> dict[str, float]:
    """Return the fractions of D values within the credible intervals of _LEVELS, and within the widest by group.

    below: (2, D), see `weight_below`. names: D.
    """
    inside = covered(below, tuple(_LEVELS.values()))
    rates = {name + suffix: rate for name, rate in zip(_LEVELS, inside.mean(axis=1), strict=True)}
    groups, belongs = _members(tuple(names))
    of_groups = (belongs & inside[-1]).sum(axis=1) / belongs.sum(axis=1)
    rates |= {f"coverage_90{suffix}_{group}": rate for group, rate in zip(groups, of_groups, strict=True)}
    return {name: float(rate) for name, rate in rates.items()}


@lru_cache
def _members(names: tuple[str, ...]) -> tuple[list[str], BoolArray]:
    """Return the G groups of GROUPS to which any of the names belong, and which of the names do, (G, D)."""
    members = {g: [any(word in name for word in words) for name in names] for g, words in GROUPS.items()}
    groups = [group for group, belongs in members.items() if any(belongs)]
    return groups, np.array([members[group] for group in groups], dtype=bool).reshape(len(groups), len(names))


@lru_cache
def _joint_groups(skeleton: Skeleton) -> dict[str, IntArray]:
    """Return the joints of the groups of GROUPS; the root is the first joint."""
    groups, belongs = _members(("root", *skeleton.names[1:]))
    return {group: np.flatnonzero(each) for group, each in zip(groups, belongs, strict=True)}


def expected_errors(step: Step, skeleton: Skeleton, relative: bool = False) -> dict[str, float]:
    """Return expected_error_<group>_mm, the error of a group that the posterior predicts: mean `expected_distances`."""
    distances = 1e3 * expected_distances(step, skeleton, relative)
    return {
        f"expected_error_{group}_mm": float(np.add.reduce(distances[members]) / len(members))  # faster than the mean
        for group, members in _joint_groups(skeleton).items()
    }


def expected_distances(step: Step, skeleton: Skeleton, relative: bool = False) -> FloatArray:
    """Return the posterior's expected distances (J,), m, of joints from those of the expected pose, with `relative` of
    their positions relative to the root.

    More than _MAX_PARTICLES particles are represented by as many at evenly spaced quantiles of their weights.
    """
    absolute, relative_to_root = _expected_distances(step, skeleton)
    return relative_to_root if relative else absolute


@lru_cache(maxsize=1)  # errors and verdict of a frame need them
def _expected_distances(step: Step, skeleton: Skeleton) -> tuple[FloatArray, FloatArray]:
    poses, weights = step.poses, np.exp(step.log_weights)
    if len(poses) > _MAX_PARTICLES:
        levels = (np.arange(_MAX_PARTICLES) + 0.5) / _MAX_PARTICLES * weights.sum()
        rows = np.searchsorted(np.cumsum(weights), levels).clip(max=len(poses) - 1)
        poses, weights = poses[rows], np.full(_MAX_PARTICLES, 1.0 / _MAX_PARTICLES)
    errors = joints(skeleton, poses) - step.expected_joints(skeleton)
    relative = errors - errors[:, :1]
    return weights @ np.linalg.norm(errors, axis=2), weights @ np.linalg.norm(relative, axis=2)


def group_errors(step: Step, skeleton: Skeleton) -> dict[str, float]:
    """Return mpjpe_abs_<group>_mm: the mean distance of the expected pose's joints from the known true ones."""
    truth = step.frame.truth
    if truth is None or truth.joints is None:
        return {}
    distances = 1e3 * np.linalg.norm(step.expected_joints(skeleton) - truth.joints, axis=1)
    known = np.isfinite(distances)
    valid = {group: distances[each[known[each]]] for group, each in _joint_groups(skeleton).items()}
    return {
        f"mpjpe_abs_{group}_mm": float(np.add.reduce(each) / len(each)) for group, each in valid.items() if len(each)
    }


def spearman(expected: FloatArray, errors: FloatArray) -> float:
    """Return Spearman's rank correlation of two series (n,); NaN where one is constant."""
    if len(expected) < 2 or min(np.ptp(expected), np.ptp(errors)) == 0.0:
        return float("nan")
    return float(scipy.stats.spearmanr(expected, errors).statistic)


def area_under_curve(expected: FloatArray, wrong: BoolArray) -> float:
    """Return the area under the receiver operating characteristic of expected errors (n,) as scores of `wrong` (n,).

    It is the probability that the score of a wrong case exceeds that of another one, ties counted half (Hanley & McNeil
    1982). NaN where all cases are of one class.
    """
    if wrong.all() or not wrong.any():
        return float("nan")
    statistic = scipy.stats.mannwhitneyu(expected[wrong], expected[~wrong]).statistic
    return float(statistic / (wrong.sum() * (~wrong).sum()))
