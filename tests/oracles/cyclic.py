"""The curves of the cyclic prior in plain NumPy, for `workbench.priors.cyclic`."""

import numpy as np

from workbench.utils.arrays import FloatArray


def decode(table: FloatArray, coefficients: FloatArray, phase: FloatArray) -> FloatArray:
    """Return channels (N, C) at phases (N,), cycles: μ(ψ) + Σ_k c_k v_k(ψ) (paper B, section 3).

    table : (M, 1 + d, C), the mean and the d scaled components at M equidistant phases, interpolated linearly.
    coefficients : (N, d), in units of the components' deviations.
    """
    index = (phase % 1.0) * len(table)
    first = np.floor(index).astype(np.int64)
    fraction = (index - first)[:, None, None]
    curves = (1.0 - fraction) * table[first % len(table)] + fraction * table[(first + 1) % len(table)]
    return curves[:, 0] + np.einsum("nk,nkc->nc", coefficients, curves[:, 1:])
