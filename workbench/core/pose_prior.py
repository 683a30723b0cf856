"""Prior over postures: a Gaussian mixture over the joint angles of a single frame."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from workbench.utils.arrays import FloatArray


@dataclass(frozen=True, eq=False)
class PosePrior:
    """Gaussian mixture Σ_k weights_k N(means_k, covariances_k) over A joint angles, rad.

    weights : (K,). means : (K, A). covariances : (K, A, A).
    """

    weights: FloatArray
    means: FloatArray
    covariances: FloatArray

    def log_components(self, postures: FloatArray) -> FloatArray:
        """Return log(weights_k N(posture; means_k, covariances_k)), (n, K), of postures (n, A)."""
        n, a = postures.shape
        exponents = np.empty((n, len(self.weights)))
        for k, (mean, whitening) in enumerate(zip(self.means, self._whitening, strict=True)):
            exponents[:, k] = -0.5 * (((postures - mean) @ whitening.T) ** 2).sum(axis=1)
        log_determinants = np.log(np.abs(np.diagonal(self._whitening, axis1=1, axis2=2))).sum(axis=1)
        return np.asarray(exponents + np.log(self.weights) + log_determinants - 0.5 * a * np.log(2.0 * np.pi))

    def responsibilities(self, postures: FloatArray) -> FloatArray:
        """Return the mixture responsibilities (n, K) of postures (n, A)."""
        return _normalised(self.log_components(postures))

    def expected_responsibilities(self, mean: FloatArray, covariance: FloatArray) -> FloatArray:
        """Return the responsibilities (K,) of the components for a posture N(mean (A,), covariance (A, A))."""
        roots = np.linalg.cholesky(self.covariances + covariance)
        whitened = np.linalg.solve(roots, (mean - self.means)[:, :, None])[:, :, 0]
        log_determinants = np.log(np.diagonal(roots, axis1=1, axis2=2)).sum(axis=1)
        return _normalised(np.log(self.weights) - 0.5 * (whitened**2).sum(axis=1) - log_determinants)

    def geometric_mean(self, mean: FloatArray, covariance: FloatArray, power: float) -> tuple[FloatArray, FloatArray]:
        """Return the geometric mean of the components to a power, a Gaussian: its mean (A,) and precision (A, A).

        Its log density is power · Σ_k r_k log N(·; means_k, covariances_k) up to a constant, with the responsibilities
        r of a posture N(mean (A,), covariance (A, A)) (a logarithmic opinion pool). power : above 0. Deviation: the
        product of a posture's density and the prior has K components; with the geometric mean it is one Gaussian.
        """
        weights = power * self.expected_responsibilities(mean, covariance)
        precision: FloatArray = np.einsum("k,kab->ab", weights, self._precisions)
        information = np.einsum("k,kab,kb->a", weights, self._precisions, self.means)
        return np.asarray(np.linalg.solve(precision, information)), precision

    @cached_property
    def _whitening(self) -> FloatArray:
        """Whitening matrices (K, A, A) of the components, lower triangular."""
        return np.asarray(np.linalg.inv(np.linalg.cholesky(self.covariances)))

    @cached_property
    def _precisions(self) -> FloatArray:
        return np.asarray(np.swapaxes(self._whitening, 1, 2) @ self._whitening)


def _normalised(log_weights: FloatArray) -> FloatArray:
    """Return weights (..., K) with sum one from their logarithms up to a constant (softmax)."""
    weights = np.exp(log_weights - log_weights.max(axis=-1, keepdims=True))
    return np.asarray(weights / weights.sum(axis=-1, keepdims=True))
