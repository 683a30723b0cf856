"""Motion models of several activities and people together: PCA of whole cycles (paper D, section 3.2 and eq. 8, 9)."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import ClassVar

import numpy as np
from scipy.interpolate import CubicSpline

from workbench.arrays import FloatArray
from workbench.body.skeleton import N_ROOT, POSE_NAMES
from workbench.errors import InputError
from workbench.learning.activity_cycles import ActivityCycles


@dataclass(frozen=True, eq=False)
class ActivityModel:
    """Θ(μ) = Θ₀(μ) + Σ_i σ_i α_i Θ_i(μ) (paper D, eq. 8, 9), d components over T phases of C joint angles, rad.

    angles: the C names of degrees of freedom. mean: (T, C), Θ₀ at phases 0, 1/T, …; periodic. components: (d, T, C),
    Θ_i, orthonormal over (T·C). scales: (d,), σ_i, the standard deviations of the coefficients over the examples.
    explained: (min(n, T·C),), the part of the variance in the first 1, 2, … components (eq. 7), of all there are.
    scores: (n, d), the coefficients α of every example, in units of the scales. activities, sources: n labels such as
    "walk", and the clips they come from. cycle_rate_hz: (n,), cycles per second of every example.
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

    SHAPES: ClassVar[Mapping[str, str]] = {
        "angles": "C", "mean": "TC", "components": "dTC", "scales": "d", "scores": "nd", "activities": "n",
        "sources": "n", "cycle_rate_hz": "n", "explained": "K",
    }  # fmt: skip

    def flaw(self) -> str:
        """Say what is missing where examples, phases or components are."""
        n_explained = min(len(self.scores), self.mean.size)
        if len(self.explained) != n_explained:
            return f"explained of shape ({n_explained},), found {self.explained.shape}"
        whole = len(self.mean) >= 2 and len(self.scales) and (self.scales > 0.0).all()
        return "" if whole else "two phases and components with a scale"

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
    def _spline(self) -> CubicSpline:
        """The mean and the scaled components (1 + d, C) over the phase."""
        curves = np.concatenate([self.mean[None], self.components * self.scales[:, None, None]]).swapaxes(0, 1)
        around = np.concatenate([curves, curves[:1]])
        return CubicSpline(np.linspace(0.0, 1.0, len(around)), around, bc_type="periodic", extrapolate="periodic")


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
