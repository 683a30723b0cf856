"""Motion models of several activities and people, and classification of activities by their coefficients.

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

MIN_SPREAD = 0.1
"""Lower bound of an activity's spread, in standard deviations of all examples: few examples may have none."""

COMPACT = 0.999  # for speed, components are computed in the subspace with this fraction of the variance


@dataclass(frozen=True, eq=False)
class ActivityModel:
    """Θ(μ) = Θ₀(μ) + Σ_i σ_i α_i Θ_i(μ) (paper D, eq. 8, 9), d components over T phases of C joint angles, rad.

    angles : the C names of degrees of freedom. mean : (T, C), Θ₀ at phases 0, 1/T, …; periodic. components : (d, T, C),
    Θ_i, orthonormal over (T·C). scales : (d,), σ_i, the standard deviations of the coefficients over the examples.
    explained : (min(n, T·C),), the fraction of the variance in the first 1, 2, … components (eq. 7). scores : (n, d),
    the coefficients α of every example, in units of the scales. activities : n labels such as "walk". cycle_rate_hz :
    (n,), cycles per second of every example. discrepancy : on held-out subjects, if known.
    """

    angles: tuple[str, ...]
    mean: FloatArray
    components: FloatArray
    scales: FloatArray
    explained: FloatArray
    scores: FloatArray
    activities: tuple[str, ...]
    cycle_rate_hz: FloatArray
    discrepancy: Discrepancy | None = None

    @property
    def pose_names(self) -> tuple[str, ...]:
        """Names of the pose parameters: the person's, or a root and all these angles of another skeleton."""
        return POSE_NAMES if set(self.angles) <= set(POSE_NAMES) else (*POSE_NAMES[:N_ROOT], *self.angles)

    def angles_at(self, alpha: FloatArray, mu: FloatArray) -> FloatArray:
        """Return joint angles (..., C), rad, for coefficients (..., d) in units of `scales` at phases (...,) in cycles.

        Phases are interpolated by a periodic cubic spline. The leading axes broadcast.
        """
        curves = self._spline(mu)
        return curves[..., 0, :] + np.einsum("...d,...dc->...c", alpha, curves[..., 1:, :])

    def jacobian_at(self, alpha: FloatArray, mu: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return derivatives of `angles_at`: (..., C, d) with respect to the coefficients, (..., C) to the phase, rad.

        They are exact derivatives of the spline; the paper stores finite differences of Θ_i along μ (after eq. 14). The
        derivative along μ includes that of the mean, which eq. 14 omits.
        """
        leading = np.broadcast_shapes(np.shape(alpha)[:-1], np.shape(mu))
        curves, rates = self._spline(mu), self._spline(mu, 1)
        by_alpha = np.swapaxes(curves[..., 1:, :], -1, -2)
        by_alpha = np.broadcast_to(by_alpha, (*leading, *by_alpha.shape[-2:]))
        by_mu: FloatArray = rates[..., 0, :] + np.einsum("...d,...dc->...c", alpha, rates[..., 1:, :])
        return np.ascontiguousarray(by_alpha), by_mu

    @cached_property
    def _spline(self) -> "scipy.interpolate.CubicSpline":
        """Periodic spline of the mean and the scaled components (1 + d, C) over the phase."""
        curves = np.concatenate([self.mean[None], self.components * self.scales[:, None, None]]).swapaxes(0, 1)
        periodic = np.concatenate([curves, curves[:1]])
        return scipy.interpolate.CubicSpline(
            np.linspace(0.0, 1.0, len(periodic)), periodic, bc_type="periodic", extrapolate="periodic"
        )


def learn_activities(
    cycles: ActivityCycles, *, angles: Sequence[str] = ("body",), variance: float = 0.9, n_components: int | None = None
) -> ActivityModel:
    """Return the model of the cycles: their mean and principal components (paper D, section 3.2).

    Parameters
    ----------
    cycles : of the training motions.
    angles : names of the joint angles to model, or of body parts, see `ActivityCycles.of_angles`.
    variance : fraction of the variance that the components explain, if n_components is None (eq. 7).
    n_components : d; None: the minimum number for `variance`.

    Raises
    ------
    InputError : fewer than two cycles, or more components than they allow.
    """
    if not 0.0 < variance < 1.0:
        raise InputError(f"activities: variance must lie between 0 and 1, found {variance}")
    chosen = cycles.of_angles(angles)
    n, n_phases, n_angles = chosen.curves.shape
    if n < 2:
        raise InputError(f"activities: expected two cycles or more, found {n}")
    mean, basis, scales = principal_components(chosen.curves.reshape(n, -1))
    explained = np.cumsum(scales**2) / np.sum(scales**2)
    maximum = min(n - 1, len(scales))
    d = min(min_components(explained, variance), maximum) if n_components is None else n_components
    if not 1 <= d <= maximum:
        raise InputError(f"activities: {n} cycles allow 1 to {maximum} components, found {d}")
    return ActivityModel(
        angles=chosen.angles, mean=mean.reshape(n_phases, n_angles),
        components=basis[:d].reshape(d, n_phases, n_angles), scales=scales[:d], explained=explained,
        scores=(chosen.curves.reshape(n, -1) - mean) @ basis[:d].T / scales[:d], activities=cycles.activities,
        cycle_rate_hz=1.0 / cycles.durations_s,
    )  # fmt: skip


def principal_components(rows: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return mean (m,), orthonormal components (K, m) and standard deviations (K,) of rows (n, m), K = min(n, m)."""
    mean = rows.mean(axis=0)
    _, singular, basis = np.linalg.svd(rows - mean, full_matrices=False)
    return mean, basis, singular / np.sqrt(len(rows) - 1)


def min_components(explained: FloatArray, variance: float) -> int:
    """Return the minimum number of components that explain more than a fraction; explained : (K,), by the first 1, 2,
    …"""
    return int(np.searchsorted(explained, variance, side="right")) + 1


@dataclass(frozen=True, eq=False)
class _Classification:
    """Class probabilities. activities : the K names, in order. probabilities : (..., K), with sum one."""

    activities: tuple[str, ...]
    probabilities: FloatArray

    @property
    def labels(self) -> NDArray[np.str_]:
        """Names (...,) of the most probable activities."""
        return np.asarray(np.array(self.activities)[self.probabilities.argmax(axis=-1)])


def classify(model: MotionModel, alpha: FloatArray) -> _Classification:
    """Classify coefficients (..., d), in units of the model's scales, among the activities of its examples.

    p(activity | α) ∝ exp(−½ (α − m)ᵀ W⁻¹ (α − m)) with m the mean of the activity's examples and W the pooled
    within-class covariance plus MIN_SPREAD² (linear discriminant analysis with equal priors). Of two activities the one
    with the nearer mean is more probable, since in these units W differs from a multiple of the identity only along the
    line between the means.
    """
    return _nearest_mean(model.scores, model.activities, alpha)


def mean_rates_hz(model: ActivityModel) -> dict[str, float]:
    """Return the mean phase speed of every activity's examples, cycles per second."""
    labels = np.array(model.activities)
    return {str(name): float(model.cycle_rate_hz[labels == name].mean()) for name in np.unique(labels)}


def held_out_accuracy(cycles: ActivityCycles, groups: Sequence[str], n_components: int) -> float:
    """Return the fraction of correctly classified cycles in cross-validation over groups, such as clips.

    groups : n labels. An activity in only one group cannot be classified correctly. Raises InputError for fewer than
    two groups, or fewer examples than components.
    """
    (rows, _), labels = _compact(cycles), np.array(cycles.activities)
    correct = np.zeros(len(rows), dtype=bool)
    for held_out, mean, basis, scales in _folds(rows, groups, n_components):
        scores = (rows - mean) @ basis / scales
        classified = _nearest_mean(scores[~held_out], labels[~held_out], scores[held_out])
        correct[held_out] = classified.labels == labels[held_out]
    return float(correct.mean())


def held_out_error_deg(cycles: ActivityCycles, groups: Sequence[str], n_components: int) -> float:
    """Return the root mean square reconstruction error of an angle, deg, in cross-validation over groups.

    The coefficients are optimal, so that this is the lower bound for any fit. As `held_out_accuracy`.
    """
    rows, squares = _compact(cycles)
    for held_out, mean, basis, _ in _folds(rows, groups, n_components):
        centred = rows[held_out] - mean
        squares[held_out] += ((centred - centred @ basis @ basis.T) ** 2).sum(axis=1)
    return float(np.degrees(np.sqrt(squares.mean() / cycles.curves[0].size)))


def _nearest_mean(
    scores: FloatArray, activities: Sequence[str] | NDArray[np.str_], alpha: FloatArray
) -> _Classification:
    names, numbers = np.unique(np.asarray(activities), return_inverse=True)
    means = np.stack([scores[numbers == k].mean(axis=0) for k in range(len(names))])
    within = scores - means[numbers]
    spread = within.T @ within / len(scores) + MIN_SPREAD**2 * np.eye(scores.shape[1])
    deviations = np.asarray(alpha)[..., None, :] - means
    logs = -0.5 * (deviations * np.linalg.solve(spread, deviations[..., None])[..., 0]).sum(axis=-1)
    weights = np.exp(logs - logs.max(axis=-1, keepdims=True))
    return _Classification(tuple(map(str, names)), weights / weights.sum(axis=-1, keepdims=True))


def _compact(cycles: ActivityCycles) -> tuple[FloatArray, FloatArray]:
    """Return the cycles in their first principal components (n, r), and their squared residuals (n,)."""
    rows = cycles.curves.reshape(len(cycles), -1)
    mean, basis, scales = principal_components(rows)
    rank = min_components(np.cumsum(scales**2) / np.sum(scales**2), COMPACT)
    coordinates = (rows - mean) @ basis.T
    return np.ascontiguousarray(coordinates[:, :rank]), (coordinates[:, rank:] ** 2).sum(axis=1)


def _folds(
    rows: FloatArray, groups: Sequence[str], d: int
) -> Iterator[tuple[BoolArray, FloatArray, FloatArray, FloatArray]]:
    """Yield, by group, a mask (n,) of the held-out rows (n, r), and mean (r,), components (r, d), scales (d,) of the
    others.

    The covariance of the others is that of all rows minus the held-out part, faster than a decomposition for every
    group.
    """
    labels, n, r = np.array(groups), *rows.shape
    names, sizes = np.unique(labels, return_counts=True)
    if len(names) < 2 or not 1 <= d <= min(n - int(sizes.max()) - 1, r):
        raise InputError(f"activities: expected two groups and more examples than {d} components, found {n} examples")
    total, scatter = rows.sum(axis=0), rows.T @ rows
    for name in tqdm(names, desc="held out", unit="group", disable=None):
        held_out = labels == name
        size = n - int(held_out.sum())
        mean = (total - rows[held_out].sum(axis=0)) / size
        removed = rows[held_out].T @ rows[held_out]
        covariance = (scatter - removed) / (size - 1) - np.outer(mean, mean) * size / (size - 1)
        variances, basis = scipy.linalg.eigh(covariance, subset_by_index=(r - d, r - 1))
        yield held_out, mean, basis[:, ::-1], np.sqrt(variances[::-1])
