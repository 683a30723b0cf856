"""Which activity the coefficients of a motion model belong to (paper D: its fig. 1b, and recognition in section 5)."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import eigh
from tqdm import tqdm

from workbench.arrays import BoolArray, FloatArray
from workbench.core.motion_model import MotionModel
from workbench.errors import InputError
from workbench.learning.activities import ActivityModel, fewest, principal_components
from workbench.learning.activity_cycles import ActivityCycles

LEAST_SPREAD = 0.1
"""Of an activity's examples about their mean, in standard deviations of all: a few examples may show none at all."""

COMPACT = 0.999  # components are sought within those of all cycles that hold this part of the variance, for speed


@dataclass(frozen=True, eq=False)
class Recognition:
    """activities: the K names, in order. probabilities: (..., K), of each, with sum one."""

    activities: tuple[str, ...]
    probabilities: FloatArray

    @property
    def labels(self) -> NDArray[np.str_]:
        """The most probable activity's name (...,)."""
        return np.asarray(np.array(self.activities)[self.probabilities.argmax(axis=-1)])


def classify(model: MotionModel, alpha: FloatArray) -> Recognition:
    """The activity of coefficients (..., d), in units of the model's scales, among those of its examples.

    p(activity | α) ∝ exp(−½ (α − m)ᵀ W⁻¹ (α − m)), m the mean of the activity's examples and W their covariance about
    their own means, pooled over the activities, plus LEAST_SPREAD². All activities are equally probable beforehand.
    Of two the more probable is that of the nearer mean, since in these units W differs from a multiple of the identity
    only along the line between the means.
    """
    return _nearest_mean(model.scores, model.activities, alpha)


def mean_rates_hz(model: ActivityModel) -> dict[str, float]:
    """The mean speed of the phase in every activity's examples, cycles per second."""
    labels = np.array(model.activities)
    return {str(name): float(model.cycle_rate_hz[labels == name].mean()) for name in np.unique(labels)}


def accuracy_left_out(cycles: ActivityCycles, groups: Sequence[str], n_components: int) -> float:
    """Part of the cycles whose activity is told right by a model that saw nothing of their group, such as their clip.

    groups: n labels. An activity that is in one group only cannot be told right. Raises InputError for fewer than two
    groups, or fewer examples than components.
    """
    (rows, _), labels = _compact(cycles), np.array(cycles.activities)
    right = np.zeros(len(rows), dtype=bool)
    for out, mean, basis, scales in _folds(rows, groups, n_components):
        scores = (rows - mean) @ basis / scales
        right[out] = _nearest_mean(scores[~out], labels[~out], scores[out]).labels == labels[out]
    return float(right.mean())


def error_left_out_deg(cycles: ActivityCycles, groups: Sequence[str], n_components: int) -> float:
    """Root mean square error of an angle, in degrees, where a model that saw nothing of a group reconstructs it.

    The coefficients are the best possible ones, so that this is the floor of any fit. As `accuracy_left_out`.
    """
    rows, squares = _compact(cycles)
    for out, mean, basis, _ in _folds(rows, groups, n_components):
        centred = rows[out] - mean
        squares[out] += ((centred - centred @ basis @ basis.T) ** 2).sum(axis=1)
    return float(np.degrees(np.sqrt(squares.mean() / cycles.curves[0].size)))


def _nearest_mean(scores: FloatArray, activities: Sequence[str] | NDArray[np.str_], alpha: FloatArray) -> Recognition:
    names, numbers = np.unique(np.asarray(activities), return_inverse=True)
    means = np.stack([scores[numbers == k].mean(axis=0) for k in range(len(names))])
    within = scores - means[numbers]
    spread = within.T @ within / len(scores) + LEAST_SPREAD**2 * np.eye(scores.shape[1])
    apart = np.asarray(alpha)[..., None, :] - means
    logs = -0.5 * (apart * np.linalg.solve(spread, apart[..., None])[..., 0]).sum(axis=-1)
    odds = np.exp(logs - logs.max(axis=-1, keepdims=True))
    return Recognition(tuple(map(str, names)), odds / odds.sum(axis=-1, keepdims=True))


def _compact(cycles: ActivityCycles) -> tuple[FloatArray, FloatArray]:
    """The cycles as rows (n, r) along their first principal components, and the squares (n,) of what that leaves."""
    rows = cycles.curves.reshape(len(cycles), -1)
    mean, basis, scales = principal_components(rows)
    kept = fewest(np.cumsum(scales**2) / np.sum(scales**2), COMPACT)
    coordinates = (rows - mean) @ basis.T
    return np.ascontiguousarray(coordinates[:, :kept]), (coordinates[:, kept:] ** 2).sum(axis=1)


def _folds(
    rows: FloatArray, groups: Sequence[str], d: int
) -> Iterator[tuple[BoolArray, FloatArray, FloatArray, FloatArray]]:
    """Which rows (n, r) are left out (n,), and mean (r,), components (r, d) and scales (d,) of the others, by group.

    The covariance of the others is that of all less what is left out, which is quicker than a decomposition of all
    rows for every group.
    """
    labels, n, r = np.array(groups), *rows.shape
    names, sizes = np.unique(labels, return_counts=True)
    if len(names) < 2 or not 1 <= d <= min(n - int(sizes.max()) - 1, r):
        raise InputError(f"activities: expected two groups and more examples than {d} components, found {n} examples")
    total, scatter = rows.sum(axis=0), rows.T @ rows
    for name in tqdm(names, desc="left out", unit="group", disable=None):
        out = labels == name
        kept = n - int(out.sum())
        mean = (total - rows[out].sum(axis=0)) / kept
        covariance = (scatter - rows[out].T @ rows[out]) / (kept - 1) - np.outer(mean, mean) * kept / (kept - 1)
        variances, basis = eigh(covariance, subset_by_index=(r - d, r - 1))
        yield out, mean, basis[:, ::-1], np.sqrt(variances[::-1])
