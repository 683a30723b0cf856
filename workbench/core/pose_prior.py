"""Which postures people take, whatever they do: a density of single frames."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from workbench.utils.arrays import FloatArray


@dataclass(frozen=True, eq=False)
class PosePrior:
    """A mixture Σ_k weights_k N(means_k, covariances_k) over A numbers of a pose, rad: weights (K,), means (K, A),
    covariances (K, A, A)."""

    weights: FloatArray
    means: FloatArray
    covariances: FloatArray

    def log_parts(self, postures: FloatArray) -> FloatArray:
        """Return log(weights_k N(posture; means_k, covariances_k)), (n, K), of postures (n, A)."""
        n, a = postures.shape
        heights = np.empty((n, len(self.weights)))
        for k, (mean, white) in enumerate(zip(self.means, self._white, strict=True)):
            heights[:, k] = -0.5 * (((postures - mean) @ white.T) ** 2).sum(axis=1)
        volumes = np.log(np.abs(np.diagonal(self._white, axis1=1, axis2=2))).sum(axis=1)
        return np.asarray(heights + np.log(self.weights) + volumes - 0.5 * a * np.log(2.0 * np.pi))

    def shares(self, postures: FloatArray) -> FloatArray:
        """Return how likely postures (n, A) are of each part, (n, K)."""
        return _normalised(self.log_parts(postures))

    def shares_of(self, mean: FloatArray, covariance: FloatArray) -> FloatArray:
        """Return how likely what is believed of a posture, N(mean (A,), covariance (A, A)), is of each part, (K,)."""
        roots = np.linalg.cholesky(self.covariances + covariance)
        white = np.linalg.solve(roots, (mean - self.means)[:, :, None])[:, :, 0]
        volumes = np.log(np.diagonal(roots, axis1=1, axis2=2)).sum(axis=1)
        return _normalised(np.log(self.weights) - 0.5 * (white**2).sum(axis=1) - volumes)

    def nearest(self, mean: FloatArray, covariance: FloatArray, power: float) -> tuple[FloatArray, FloatArray]:
        """Return mean (A,) and precision (A, A) of the Gaussian that `drawn` multiplies what is believed of a posture,
        N(mean (A,), covariance (A, A)), by. power: above 0."""
        precision, pull = self._pooled(mean, covariance, power)
        return np.asarray(np.linalg.solve(precision, pull)), precision

    def drawn(self, mean: FloatArray, covariance: FloatArray, power: float) -> tuple[FloatArray, FloatArray]:
        """Multiply a Gaussian N(mean (P,), covariance (P, P)) of poses, whose last A numbers are the posture, by one
        of the postures to a power; return mean and covariance of the product.

        The postures' is that whose log density is the mean one of the parts', Σ_k shares_k log N(·; means_k,
        covariances_k), by how likely what is believed is of each. Raises LinAlgError for a covariance that is not one.

        Deviations: a power below 1, as the Gaussian may know something of postures already and neighbouring frames say
        the same; and one Gaussian, where the product has as many as there are parts.
        """
        posture = slice(len(mean) - self.means.shape[1], None)
        precision = np.linalg.inv(covariance + 1e-12 * np.eye(len(mean)))
        own, pulling = self._pooled(mean[posture], covariance[posture, posture], power)
        total, pull = precision.copy(), precision @ mean
        total[posture, posture] += own
        pull[posture] += pulling
        narrowed = np.linalg.inv(total)
        return np.linalg.solve(total, pull), 0.5 * (narrowed + narrowed.T)

    def _pooled(self, mean: FloatArray, covariance: FloatArray, power: float) -> tuple[FloatArray, FloatArray]:
        """Return the precision (A, A) of the parts' Gaussians, each to the power of its share and all to a power, and
        that times their mean (A,)."""
        shares = power * self.shares_of(mean, covariance)
        precision: FloatArray = np.einsum("k,kab->ab", shares, self._precisions)
        return precision, np.einsum("k,kab,kb->a", shares, self._precisions, self.means)

    @cached_property
    def _white(self) -> FloatArray:
        """What makes each part's differences white, (K, A, A), lower triangular."""
        return np.asarray(np.linalg.inv(np.linalg.cholesky(self.covariances)))

    @cached_property
    def _precisions(self) -> FloatArray:
        return np.asarray(np.swapaxes(self._white, 1, 2) @ self._white)


def _normalised(heights: FloatArray) -> FloatArray:
    """Return shares (..., K) that sum to one, of their logarithms up to a constant."""
    shares = np.exp(heights - heights.max(axis=-1, keepdims=True))
    return np.asarray(shares / shares.sum(axis=-1, keepdims=True))
