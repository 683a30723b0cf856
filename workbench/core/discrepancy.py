"""What a learned motion misses of a person it was not learned from."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from workbench.utils.arrays import FloatArray

LEARNED_HZ = 30.0
"""The frames a second for which `Discrepancy.ar_coefficients` is given."""
LEAST_PEOPLE = 3
"""Of fewer the spread has no finite estimate; they count as so many."""


@dataclass(frozen=True, eq=False)
class Discrepancy:
    """Residuals δ of C joint angles between a person and the nearest pose of a model, as a Gaussian autoregression:

        δ_t ~ N(0, W Wᵀ + diag(s²)),  corr(δ_t,c, δ_t+Δt,c) = a_c^(Δt · 30 Hz)

    angles: the C names of degrees of freedom. loadings: (C, r), W, rad. rest: (C,), s, rad. ar_coefficients: (C,), a, from 0 to below
    1. n_people: how many were left out in turn to learn it.
    """

    angles: tuple[str, ...]
    loadings: FloatArray
    rest: FloatArray
    ar_coefficients: FloatArray
    n_people: int

    @property
    def covariance(self) -> FloatArray:
        """(C, C), rad²."""
        return self.loadings @ self.loadings.T + np.diag(self.rest**2)

    @property
    def deviations(self) -> FloatArray:
        """(C,), rad, the roots of the covariance's diagonal."""
        return np.sqrt(self.rest**2 + (self.loadings**2).sum(axis=1))

    def root(self, names: Sequence[str]) -> FloatArray:
        """Give A (P, r + C) for a pose with P numbers of these names, A Aᵀ being the covariance of what is missed; rows
        of zeros for those that the model does not speak of."""
        root = np.zeros((len(names), self.loadings.shape[1] + len(self.angles)))
        rows = [k for k, angle in enumerate(self.angles) if angle in names]
        places = [names.index(self.angles[k]) for k in rows]
        root[places] = np.hstack([self.loadings, np.diag(self.rest)])[rows]
        return root


def widening(n_people: int) -> float:
    """Factor of deviations that were learned from n people, about a mean that is known: √(n / (n − 2)).

    The deviation is an estimate, too: of normal people, the next is then Student's with n degrees of freedom (Gelman et
    al., *Bayesian Data Analysis*, 3rd ed. 2013, section 3.2), of which this is the deviation. 1.18 for seven people.
    """
    n = max(n_people, LEAST_PEOPLE)
    return float((n / (n - 2)) ** 0.5)
