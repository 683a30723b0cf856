"""The Gaussian posterior of the poses of all frames, its covariances and its samples of whole motions."""

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from workbench.inference.least_squares.solver.sparse_solver import Factor
from workbench.utils.arrays import FloatArray

N_DRAWS = 40
"""Samples of the motion in a recording. The 5 % quantile of 40 normal numbers has a standard error of
√(0.05 · 0.95 / 40) / 0.103 = 0.33 standard deviations, with the density 0.103 there."""


@dataclass(frozen=True, eq=False)
class SystematicErrors:
    """Errors of the poses that independent normal numbers g (G,), the same in all frames, cause: errors · g.

    errors: (T, P, G), for one unit of each number. variance: of the numbers.
    """

    errors: FloatArray
    variance: float = 1.0


@dataclass(frozen=True, eq=False)
class MotionPosterior:
    """Poses of T frames with independent normal errors: x = poses + L⁻ᵀ z + Σ_k errors_k g_k.

    poses: (T, P). noise: Cholesky factor L of the Gauss–Newton matrix (Laplace approximation), of the errors that
    differ between frames. systematic: errors that all frames share.
    """

    poses: FloatArray
    noise: Factor
    systematic: tuple[SystematicErrors, ...] = ()

    def including(self, *systematic: SystematicErrors) -> "MotionPosterior":
        """Return the posterior with further systematic errors."""
        return replace(self, systematic=(*self.systematic, *systematic))

    @cached_property
    def covariances(self) -> FloatArray:
        """The marginal covariances (T, P, P) of the poses."""
        covariances = self.noise.covariances(np.arange(self.poses.size).reshape(self.poses.shape))
        for each in self.systematic:
            covariances += each.variance * (each.errors @ each.errors.swapaxes(1, 2))
        return covariances

    def draws(self, n: int, rng: np.random.Generator) -> FloatArray:
        """Return n samples (n, T, P) of the poses of all frames, with the errors' correlation over time."""
        samples = self.noise.sample(n, rng)
        samples += self.poses.reshape(-1, 1)
        for each in self.systematic:
            numbers = np.sqrt(each.variance) * rng.standard_normal((each.errors.shape[2], n))
            samples += each.errors.reshape(len(samples), -1) @ numbers
        return np.moveaxis(samples.reshape(*self.poses.shape, n), 2, 0)
