"""Learn what a cyclic motion model misses of people it was not learned from, by leaving people out in turn."""

from collections.abc import Sequence

import numpy as np

from workbench.core.discrepancy import LEARNED_HZ, Discrepancy
from workbench.motion.models.activities import principal_components
from workbench.utils.arrays import FloatArray

MOST_FOLDS = 8
"""Groups of people that are left out in turn; everyone on their own where there are no more."""
FIT_SIGMA_RAD = 0.1
"""Deviation of an angle while the nearest pose is looked for, that of the priors' starts."""
COMMON = 0.8
"""The part of the residual variance that the loadings stand for at least; the rest is each angle's own."""
MOST_KEPT = 0.99


def learn_discrepancy(
    angles: Sequence[str],
    curves: FloatArray,
    durations_s: FloatArray,
    people: Sequence[str],
    n_components: int,
) -> Discrepancy | None:
    """Learn the residual angles of people left out; None where there are fewer than two, or too few cycles of others.

    curves: (n, T, C) cycles of joint angles, rad, at phases 0, 1/T, …. durations_s: (n,). people: n names, whose the
    cycles are. n_components: of the model.

    For each group of people, PCA of all others' cycles makes a model, and every pose of theirs, at each phase, is
    fitted by its `nearest_angles`, phase and coefficients free. Every person counts alike, and so their own mean
    residual does: it is what the next person's will be drawn from. Autocorrelations are those of neighbouring phases.

    Deviation. Whatever learned the model, here it is plain PCA of whole cycles: its people and its number of components
    matter, not how channels were weighed or gaps filled.
    """
    everyone = sorted(set(people))
    folds = np.array([everyone.index(name) % MOST_FOLDS for name in people], dtype=np.int64)
    n_phases, n_angles = curves.shape[1:]
    residuals = np.empty_like(curves)
    for fold in np.unique(folds):
        others = curves[folds != fold]
        if len(others) <= n_components:
            return None
        mean, axes, scales = principal_components(others.reshape(len(others), -1))
        basis = axes[:n_components] * scales[:n_components, None]
        model = mean.reshape(n_phases, n_angles), basis.reshape(-1, n_phases, n_angles)
        residuals[folds == fold] = curves[folds == fold] - nearest_angles(*model, curves[folds == fold])
    owners = [np.flatnonzero(np.array(people) == name) for name in everyone]
    moments = np.mean([_second_moment(residuals[own]) for own in owners], axis=0)
    lagged = np.mean([(residuals[own, 1:] * residuals[own, :-1]).mean(axis=(0, 1)) for own in owners], axis=0)
    frames = LEARNED_HZ * float(np.mean(durations_s)) / n_phases
    correlation = np.clip(lagged / np.diagonal(moments), 1e-6, 1.0)
    loadings, rest = low_rank(moments, COMMON)
    keep = np.minimum(correlation ** (1.0 / frames), MOST_KEPT)
    return Discrepancy(tuple(angles), loadings, rest, keep, len(everyone))


def nearest_angles(mean: FloatArray, basis: FloatArray, angles: FloatArray) -> FloatArray:
    """Fit the angles (..., C), rad, by the model's, with any phase and coefficients that are N(0, 1).

    mean: (T, C). basis: (d, T, C), components times their scales. An angle's deviation is FIT_SIGMA_RAD. At one phase
    the least cost over the coefficients is rᵀ (B Bᵀ + σ² I)⁻¹ r with r what the mean misses, and the fit then
    B Bᵀ (B Bᵀ + σ² I)⁻¹ r; the phase with the least cost wins.
    """
    flat = angles.reshape(-1, angles.shape[-1])
    best, least = np.empty_like(flat), np.full(len(flat), np.inf)
    for phase in range(len(mean)):
        spread = basis[:, phase].T @ basis[:, phase]
        inverse = np.linalg.inv(spread + FIT_SIGMA_RAD**2 * np.eye(len(spread)))
        missed = flat - mean[phase]
        whitened = missed @ inverse
        cost = (whitened * missed).sum(axis=1)
        better = cost < least
        least[better] = cost[better]
        best[better] = mean[phase] + whitened[better] @ spread
    return best.reshape(angles.shape)


def _second_moment(residuals: FloatArray) -> FloatArray:
    """E δ δᵀ (C, C) of residuals (..., C), about zero."""
    rows = residuals.reshape(-1, residuals.shape[-1])
    return rows.T @ rows / len(rows)


def low_rank(covariance: FloatArray, common: float) -> tuple[FloatArray, FloatArray]:
    """Give W (C, r) and s (C,) with W Wᵀ + diag(s²) nearly a covariance (C, C), and its diagonal exactly.

    W has the first principal axes, as many as explain at least the part `common` of the variance.
    """
    values, vectors = np.linalg.eigh(covariance)
    values, vectors = np.maximum(values[::-1], 0.0), vectors[:, ::-1]
    rank = int(np.searchsorted(np.cumsum(values) / values.sum(), common)) + 1
    loadings = vectors[:, :rank] * np.sqrt(values[:rank])
    return loadings, np.sqrt(np.maximum(np.diagonal(covariance) - (loadings**2).sum(axis=1), 0.0))
