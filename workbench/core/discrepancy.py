"""Model discrepancy: the residual of a learned motion model on held-out subjects, as a Gaussian autoregression."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from workbench.utils.arrays import FloatArray

DISCREPANCY_RATE_HZ = 30.0
"""Frame rate of `Discrepancy.ar_coefficients`."""
MIN_SUBJECTS = 3
"""The spread of fewer subjects has no finite estimate; they count as this many."""


@dataclass(frozen=True, eq=False)
class Discrepancy:
    """Residuals δ of C joint angles between a person and the nearest pose of a model:

        δ_t ~ N(0, W Wᵀ + diag(s²)),  corr(δ_t,c, δ_t+Δt,c) = a_c^(Δt · 30 Hz)

    angles : C names of degrees of freedom. loadings : (C, r), W, rad. residual_std : (C,), s, rad.
    ar_coefficients : (C,), a, in [0, 1). n_subjects : number of subjects in the cross-validation.
    """

    angles: tuple[str, ...]
    loadings: FloatArray
    residual_std: FloatArray
    ar_coefficients: FloatArray
    n_subjects: int

    @property
    def std(self) -> FloatArray:
        """Marginal standard deviations (C,), rad."""
        return np.sqrt(self.residual_std**2 + (self.loadings**2).sum(axis=1))

    def covariance_root(self, names: Sequence[str]) -> FloatArray:
        """Return A (P, r + C) with A Aᵀ the residual covariance of a pose with P parameters of these names.

        Rows of parameters outside the model are zero.
        """
        root = np.zeros((len(names), self.loadings.shape[1] + len(self.angles)))
        rows = [k for k, angle in enumerate(self.angles) if angle in names]
        columns = [names.index(self.angles[k]) for k in rows]
        root[columns] = np.hstack([self.loadings, np.diag(self.residual_std)])[rows]
        return root


def small_sample_inflation(n_subjects: int) -> float:
    """Return the inflation √(n / (n − 2)) of standard deviations that were estimated from n subjects.

    The mean is known; the standard deviation is an estimate. The predictive distribution of the next subject is
    Student's t with n degrees of freedom (Gelman et al., *Bayesian Data Analysis*, 3rd ed. 2013, section 3.2), whose
    standard deviation has this factor: 1.18 for seven subjects.
    """
    n = max(n_subjects, MIN_SUBJECTS)
    return float((n / (n - 2)) ** 0.5)
