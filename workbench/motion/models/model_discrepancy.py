"""Discrepancy of a cyclic motion model on held-out subjects, estimated by cross-validation over subjects."""

from collections.abc import Sequence

import numpy as np

from workbench.core.discrepancy import DISCREPANCY_RATE_HZ, Discrepancy
from workbench.motion.models.activities import principal_components
from workbench.utils.arrays import FloatArray

MAX_FOLDS = 8
"""Of the cross-validation over subjects; leave-one-subject-out for at most as many subjects."""
FIT_SIGMA_RAD = 0.1
"""Standard deviation of an angle in the fit of the nearest pose, as in the priors' initial states."""
COMMON = 0.8
"""Minimum fraction of the residual variance that the loadings explain; the rest is independent for each angle."""
MAX_AR_COEFFICIENT = 0.99


def learn_discrepancy(
    angles: Sequence[str], curves: FloatArray, durations_s: FloatArray, subjects: Sequence[str], n_components: int
) -> Discrepancy | None:
    """Estimate the residual angles of held-out subjects.

    For each fold of subjects, PCA of all other cycles gives a model, and every held-out pose, at each phase, is fitted
    by its `nearest_angles` with free phase and coefficients. Every subject has the same weight, and residuals include
    the subject's mean, since the next subject's mean residual is a sample of the same distribution. Autocorrelations
    are those of neighbouring phases.

    Deviation: the model is plain PCA of whole cycles, however the motion model was learned. Only its subjects and its
    number of components matter here, not channel weights or imputation.

    Parameters
    ----------
    angles : C names.
    curves : (n, T, C) cycles of the joint angles, rad, at phases 0, 1/T, ….
    durations_s : (n,).
    subjects : n names of the cycles' subjects.
    n_components : of the model.

    Returns
    -------
    None for fewer than two subjects, or too few cycles outside a fold.
    """
    names = sorted(set(subjects))
    folds = np.array([names.index(name) % MAX_FOLDS for name in subjects], dtype=np.int64)
    n_phases, n_angles = curves.shape[1:]
    residuals = np.empty_like(curves)
    for fold in np.unique(folds):
        training = curves[folds != fold]
        if len(training) <= n_components:
            return None
        mean, axes, scales = principal_components(training.reshape(len(training), -1))
        basis = axes[:n_components] * scales[:n_components, None]
        model = mean.reshape(n_phases, n_angles), basis.reshape(-1, n_phases, n_angles)
        residuals[folds == fold] = curves[folds == fold] - nearest_angles(*model, curves[folds == fold])
    rows = [np.flatnonzero(np.array(subjects) == name) for name in names]
    moments = np.mean([_second_moment(residuals[each]) for each in rows], axis=0)
    lagged = np.mean([(residuals[each, 1:] * residuals[each, :-1]).mean(axis=(0, 1)) for each in rows], axis=0)
    frames = DISCREPANCY_RATE_HZ * float(np.mean(durations_s)) / n_phases
    correlation = np.clip(lagged / np.diagonal(moments), 1e-6, 1.0)
    loadings, residual_std = low_rank(moments, COMMON)
    ar_coefficients = np.minimum(correlation ** (1.0 / frames), MAX_AR_COEFFICIENT)
    return Discrepancy(tuple(angles), loadings, residual_std, ar_coefficients, len(names))


def nearest_angles(mean: FloatArray, basis: FloatArray, angles: FloatArray) -> FloatArray:
    """Return the model's nearest angles (..., C), rad, over phases and N(0, 1) coefficients.

    With r the deviation from the mean at one phase, the minimum cost over the coefficients is rᵀ (B Bᵀ + σ² I)⁻¹ r and
    the fit is B Bᵀ (B Bᵀ + σ² I)⁻¹ r, σ = FIT_SIGMA_RAD. The phase with the minimum cost is chosen.

    Parameters
    ----------
    mean : (T, C), rad.
    basis : (d, T, C), components times their scales, rad.
    angles : (..., C), rad.
    """
    flat = angles.reshape(-1, angles.shape[-1])
    fitted, min_cost = np.empty_like(flat), np.full(len(flat), np.inf)
    for phase in range(len(mean)):
        spread = basis[:, phase].T @ basis[:, phase]
        inverse = np.linalg.inv(spread + FIT_SIGMA_RAD**2 * np.eye(len(spread)))
        residual = flat - mean[phase]
        weighted = residual @ inverse
        cost = (weighted * residual).sum(axis=1)
        better = cost < min_cost
        min_cost[better] = cost[better]
        fitted[better] = mean[phase] + weighted[better] @ spread
    return fitted.reshape(angles.shape)


def _second_moment(residuals: FloatArray) -> FloatArray:
    """Return E δ δᵀ (C, C) of residuals (..., C), about zero."""
    rows = residuals.reshape(-1, residuals.shape[-1])
    return rows.T @ rows / len(rows)


def low_rank(covariance: FloatArray, common: float) -> tuple[FloatArray, FloatArray]:
    """Return W (C, r) and s (C,) with W Wᵀ + diag(s²) close to a covariance (C, C) and equal on its diagonal.

    W has the first principal axes, the fewest that explain at least the fraction `common` of the variance.
    """
    values, vectors = np.linalg.eigh(covariance)
    values, vectors = np.maximum(values[::-1], 0.0), vectors[:, ::-1]
    rank = int(np.searchsorted(np.cumsum(values) / values.sum(), common)) + 1
    loadings = vectors[:, :rank] * np.sqrt(values[:rank])
    return loadings, np.sqrt(np.maximum(np.diagonal(covariance) - (loadings**2).sum(axis=1), 0.0))
