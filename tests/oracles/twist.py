"""Exact filter of one parameter under the constant-velocity prior, by enumeration of a grid.

It follows A, section 6.1, for the twist of an upper arm whose elbow is straight and then bends: the probabilities of
the twist and its velocity are on a grid, and observations depend on the twist alone.
"""

from dataclasses import dataclass

import numpy as np
from scipy.special import ndtr

from workbench.utils.arrays import FloatArray

WRIST_STD_M = 0.03
"""Standard deviation of an observed offset of the wrist."""


def wrist_offsets(twist: FloatArray, elbow: float, forearm_m: float = 0.26) -> FloatArray:
    """Return the offset (n, 2) of the wrist from the line of the upper arm, m: none for a straight elbow."""
    return forearm_m * np.sin(elbow) * np.column_stack([np.cos(twist), np.sin(twist)])


@dataclass(frozen=True)
class TwistGrid:
    """Cells of twist and velocity. twists: (n,) centres within the limits, rad. velocities: (m,), rad/s. sigma,
    sigma_velocity: deviations per frame. dt_s: between frames. normalized: see `workbench.priors.smooth.Smooth`."""

    twists: FloatArray
    velocities: FloatArray
    sigma: float
    sigma_velocity: float
    dt_s: float
    normalized: bool

    def predict(self, cells: FloatArray) -> FloatArray:
        """Return the probabilities (n, m) after a transition of cells (n, m), which need not sum to one."""
        half = 0.5 * (self.twists[1] - self.twists[0])
        moved = np.empty_like(cells)
        edges = np.append(self.twists - half, self.twists[-1] + half)
        for k, velocity in enumerate(self.velocities):
            mean = self.twists + velocity * self.dt_s
            matrix = np.diff(ndtr((edges - mean[:, None]) / self.sigma), axis=1)  # (from, to)
            if self.normalized:  # the tail of a mean far beyond a limit is in the cell at that limit
                total = matrix.sum(axis=1, keepdims=True)
                last = np.eye(len(mean))[np.where(mean < 0.0, 0, len(mean) - 1)]
                matrix = np.where(total > 1e-12, matrix / np.maximum(total, 1e-12), last)
            moved[:, k] = cells[:, k] @ matrix
        kernel = np.exp(-0.5 * ((self.velocities - self.velocities[:, None]) / self.sigma_velocity) ** 2)
        return moved @ (kernel / kernel.sum(axis=1, keepdims=True))

    def posteriors(self, cells: FloatArray, elbows: FloatArray, observed: FloatArray) -> FloatArray:
        """Return the posterior (F, n) of the twist after each transition from cells (n, m), for elbows (F,), rad, and
        observed offsets of the wrist (F, 2)."""
        marginals = []
        for elbow, offset in zip(elbows, observed, strict=True):
            residuals = (wrist_offsets(self.twists, elbow) - offset) / WRIST_STD_M
            cells = self.predict(cells) * np.exp(-0.5 * (residuals**2).sum(axis=1))[:, None]
            cells = cells / cells.sum()
            marginals.append(cells.sum(axis=1))
        return np.array(marginals)
