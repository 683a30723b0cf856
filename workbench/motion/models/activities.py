"""Motion models of several activities and people together, and which activity their coefficients belong to.

Paper D: PCA of whole cycles (section 3.2 and eq. 8, 9), its fig. 1b, and recognition in section 5.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import scipy
from numpy.typing import NDArray
from tqdm import tqdm

from workbench.body.skeleton import N_ROOT, POSE_NAMES
from workbench.core.discrepancy import Discrepancy
from workbench.core.prior import MotionModel
from workbench.motion.models.activity_cycles import ActivityCycles
from workbench.utils.arrays import BoolArray, FloatArray
from workbench.utils.errors import InputError

LEAST_SPREAD = 0.1
"""An activity's examples about their mean, in standard deviations of all: a few examples may show none at all."""

COMPACT = 0.999  # components are sought within those of all cycles that hold this part of the variance, for speed


@dataclass(frozen=True, eq=False)
class ActivityModel:
    """Θ(μ) = Θ₀(μ) + Σ_i σ_i α_i Θ_i(μ) (paper D, eq. 8, 9), d components over T phases of C joint angles, rad.

    angles: the C names of degrees of freedom. mean: (T, C), Θ₀ at phases 0, 1/T, …; periodic. components: (d, T, C),
    Θ_i, orthonormal over (T·C). scales: (d,), σ_i, the standard deviations of the coefficients over the examples.
    explained: (min(n, T·C),), the part of the variance in the first 1, 2, … components (eq. 7), of all there are.
    scores: (n, d), the coefficients α of every example, in units of the scales. activities, sources: n labels such as
    "walk", and the clips they come from. cycle_rate_hz: (n,), cycles per second of every example. discrepancy: what it
    misses of people it was not learned from, where that is known.
    """

    angles: tuple[str, ...]
    mean: FloatArray
    components: FloatArray
    scales: FloatArray
    explained: FloatArray
    scores: FloatArray
    activities: tuple[str, ...]
    sources: tuple[str, ...]
    cycle_rate_hz: FloatArray
    discrepancy: Discrepancy | None = None

    @property
    def pose_names(self) -> tuple[str, ...]:
        """The pose that the angles belong to: the person's, or a root and all these angles of another skeleton."""
        return POSE_NAMES if set(self.angles) <= set(POSE_NAMES) else (*POSE_NAMES[:N_ROOT], *self.angles)

    def angles_at(self, alpha: FloatArray, mu: FloatArray) -> FloatArray:
        """The joint angles (..., C), rad, for coefficients (..., d) in units of `scales` at phases (...,) in cycles.

        Between the phases of the model a periodic cubic spline. The leading axes of both broadcast.
        """
        curves = self._spline(mu)
        return curves[..., 0, :] + np.einsum("...d,...dc->...c", alpha, curves[..., 1:, :])

    def jacobian_at(self, alpha: FloatArray, mu: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Derivatives of `angles_at`: (..., C, d) with respect to the coefficients, (..., C) to the phase, rad.

        Those of the spline itself: where the paper stores finite differences of Θ_i along μ (after eq. 14), these are
        exact. As in `angles_at` the derivative along μ has that of the mean, which eq. 14's display leaves out.
        """
        leading = np.broadcast_shapes(np.shape(alpha)[:-1], np.shape(mu))
        curves, rates = self._spline(mu), self._spline(mu, 1)
        by_alpha = np.swapaxes(curves[..., 1:, :], -1, -2)
        by_alpha = np.broadcast_to(by_alpha, (*leading, *by_alpha.shape[-2:]))
        by_mu: FloatArray = rates[..., 0, :] + np.einsum("...d,...dc->...c", alpha, rates[..., 1:, :])
        return np.ascontiguousarray(by_alpha), by_mu

    @cached_property
    def _spline(self) -> "scipy.interpolate.CubicSpline":
        """The mean and the scaled components (1 + d, C) over the phase."""
        curves = np.concatenate([self.mean[None], self.components * self.scales[:, None, None]]).swapaxes(0, 1)
        around = np.concatenate([curves, curves[:1]])
        return scipy.interpolate.CubicSpline(
            np.linspace(0.0, 1.0, len(around)), around, bc_type="periodic", extrapolate="periodic"
        )


def learn_activities(
    cycles: ActivityCycles, *, angles: Sequence[str] = ("body",), variance: float = 0.9, n_components: int | None = None
) -> ActivityModel:
    """The model of the cycles: their mean and principal components (paper D, section 3.2).

    angles: names of the joint angles to model, or parts of the body, see `ActivityCycles.of_angles`. n_components: the
    number d; None takes the fewest that explain more than the fraction `variance` of the variance (eq. 7).
    Raises InputError when there are fewer than two cycles, or more components are asked for than there are.
    """
    if not 0.0 < variance < 1.0:
        raise InputError(f"activities: variance must lie between 0 and 1, found {variance}")
    chosen = cycles.of_angles(angles)
    n, n_phases, n_angles = chosen.curves.shape
    if n < 2:
        raise InputError(f"activities: expected two cycles or more, found {n}")
    mean, basis, scales = principal_components(chosen.curves.reshape(n, -1))
    explained = np.cumsum(scales**2) / np.sum(scales**2)
    most = min(n - 1, len(scales))
    d = min(fewest(explained, variance), most) if n_components is None else n_components
    if not 1 <= d <= most:
        raise InputError(f"activities: {n} cycles allow 1 to {most} components, found {d}")
    return ActivityModel(
        angles=chosen.angles, mean=mean.reshape(n_phases, n_angles),
        components=basis[:d].reshape(d, n_phases, n_angles), scales=scales[:d], explained=explained,
        scores=(chosen.curves.reshape(n, -1) - mean) @ basis[:d].T / scales[:d], activities=cycles.activities,
        sources=cycles.sources, cycle_rate_hz=1.0 / cycles.durations_s,
    )  # fmt: skip


def principal_components(rows: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Mean (m,), orthonormal components (K, m) and standard deviations (K,) of rows (n, m), K = min(n, m)."""
    mean = rows.mean(axis=0)
    _, singular, basis = np.linalg.svd(rows - mean, full_matrices=False)
    return mean, basis, singular / np.sqrt(len(rows) - 1)


def fewest(explained: FloatArray, variance: float) -> int:
    """Tell how many components explain more than a part of the variance; explained: (K,), that of the first 1, 2, …"""
    return int(np.searchsorted(explained, variance, side="right")) + 1


@dataclass(frozen=True, eq=False)
class _Recognition:
    """activities: the K names, in order. probabilities: (..., K), of each, with sum one."""

    activities: tuple[str, ...]
    probabilities: FloatArray

    @property
    def labels(self) -> NDArray[np.str_]:
        """The most probable activity's name (...,)."""
        return np.asarray(np.array(self.activities)[self.probabilities.argmax(axis=-1)])


def classify(model: MotionModel, alpha: FloatArray) -> _Recognition:
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


def _nearest_mean(scores: FloatArray, activities: Sequence[str] | NDArray[np.str_], alpha: FloatArray) -> _Recognition:
    names, numbers = np.unique(np.asarray(activities), return_inverse=True)
    means = np.stack([scores[numbers == k].mean(axis=0) for k in range(len(names))])
    within = scores - means[numbers]
    spread = within.T @ within / len(scores) + LEAST_SPREAD**2 * np.eye(scores.shape[1])
    apart = np.asarray(alpha)[..., None, :] - means
    logs = -0.5 * (apart * np.linalg.solve(spread, apart[..., None])[..., 0]).sum(axis=-1)
    odds = np.exp(logs - logs.max(axis=-1, keepdims=True))
    return _Recognition(tuple(map(str, names)), odds / odds.sum(axis=-1, keepdims=True))


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

    The covariance of the others is that of all less what is left out, quicker than a decomposition for every group.
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
        variances, basis = scipy.linalg.eigh(covariance, subset_by_index=(r - d, r - 1))
        yield out, mean, basis[:, ::-1], np.sqrt(variances[::-1])
