"""Robust losses of whitened residuals, for iteratively reweighted least squares (Holland & Welsch 1977).

Every loss takes z = residual / scale, (K,), to ρ(z) and the weight ρ'(z) / z, both (K,). Near zero all are ½ z² with
weight 1, so that they differ only in how they treat what is far off. Paper D has the squared loss alone.
"""

from collections.abc import Callable, Mapping
from types import MappingProxyType
from typing import TypeAlias

import numpy as np

from workbench.arrays import FloatArray

RobustLoss: TypeAlias = Callable[[FloatArray], tuple[FloatArray, FloatArray]]


def squared(z: FloatArray) -> tuple[FloatArray, FloatArray]:
    """ρ = ½ z²: one far point outweighs everything else."""
    return 0.5 * z * z, np.ones_like(z)


def huber(z: FloatArray) -> tuple[FloatArray, FloatArray]:
    """ρ = ½ z² up to |z| = 1, |z| − ½ beyond: far points pull with a constant force (Huber 1964)."""
    size = np.abs(z)
    return np.where(size <= 1.0, 0.5 * z * z, size - 0.5), 1.0 / np.maximum(size, 1.0)


def geman_mcclure(z: FloatArray) -> tuple[FloatArray, FloatArray]:
    """ρ = ½ z² / (1 + z²): redescends, far points do not pull at all (Geman & McClure 1987)."""
    kept = 1.0 / (1.0 + z * z)
    return 0.5 * (1.0 - kept), kept * kept


LOSSES: Mapping[str, RobustLoss] = MappingProxyType(
    {"squared": squared, "huber": huber, "geman_mcclure": geman_mcclure}
)
