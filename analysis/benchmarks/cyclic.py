"""Cyclic learning from complete data, compared with scikit-fda's functional PCA of the same cycles.

Both estimate the mean, five shared components and the reconstruction of N_SLICES cycles of 19 angles at 64 phases,
which consist of five components of all angles and noise. scikit-fda represents curves of one angle; it estimates shared
components from the concatenated curves of all angles.
"""

from functools import partial
from importlib.util import find_spec

import numpy as np
from threadpoolctl import threadpool_limits

from analysis.benchmarks.figure import Figure, not_measured
from analysis.benchmarks.measuring import fastest_s
from workbench.motion.models.functional_pca import Slices, fpca_paper
from workbench.utils.arrays import FloatArray

N_SLICES, N_PHASES, N_ANGLES, Q = 700, 64, 19, 5


def figures() -> list[Figure]:
    """Measure how many times faster than scikit-fda the same result is found."""
    what = ("cyclic_vs_scikit_fda", "× faster", 1.0, "higher")
    if find_spec("skfda") is None:
        return [not_measured(*what, 'scikit-fda is not installed: pip install -e ".[bench]"')]
    slices = _complete(np.random.default_rng(0))
    with threadpool_limits(limits=1, user_api="blas"):
        ours, joint = fastest_s([partial(fpca_paper, slices, Q), partial(_joint, slices.values)])
        angle = _subspace_angle(fpca_paper(slices, Q).components, _joint(slices.values)[0])
    return [
        Figure(
            what[0], joint / ours, *what[1:],
            f"scikit-fda, the same components to {angle:.1g}: {1e3 * joint:.0f} ms; {N_SLICES} cycles × {N_PHASES} "
            f"phases × {N_ANGLES} angles, one thread; ours {1e3 * ours:.0f} ms",
        )
    ]  # fmt: skip


def _complete(rng: np.random.Generator) -> Slices:
    """Return cycles of smooth curves: a mean, Q ways to vary from cycle to cycle, and noise."""
    orders = np.arange(1, 9)
    waves = rng.standard_normal((Q + 1, N_ANGLES, 8)) + 1j * rng.standard_normal((Q + 1, N_ANGLES, 8))
    turns = np.exp(2j * np.pi * np.arange(N_PHASES)[:, None] / N_PHASES * orders) / orders
    curves = np.einsum("to,kao->kta", turns, waves).real
    amounts = rng.standard_normal((N_SLICES, Q)) * np.linspace(0.5, 0.2, Q)
    values = curves[0] + np.einsum("nk,kta->nta", amounts, curves[1:])
    values += 0.05 * rng.standard_normal(values.shape)
    sequence, cycle = np.divmod(np.arange(N_SLICES), N_SLICES // 20)
    return Slices(values, np.ones(values.shape, dtype=bool), sequence, cycle)


def _joint(values: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return scikit-fda's components (Q, T, m) and reconstructed cycles (N, T, m), all angles as one curve."""
    from skfda import FDataGrid
    from skfda.preprocessing.dim_reduction import FPCA

    n, n_phases, m = values.shape
    curves = FDataGrid(values.transpose(0, 2, 1).reshape(n, -1), np.arange(n_phases * m) / n_phases)
    fpca = FPCA(n_components=Q, _weights=np.full(n_phases * m, 1.0 / n_phases))
    reconstructed = fpca.inverse_transform(fpca.fit_transform(curves))
    components, cycles = (
        curves.data_matrix.reshape(-1, m, n_phases).transpose(0, 2, 1) for curves in (fpca.components_, reconstructed)
    )
    return components, cycles


def _subspace_angle(ours: FloatArray, theirs: FloatArray) -> float:
    """Return the sine of the largest angle between what two sets of components (Q, T, m) span."""
    spans = [np.linalg.qr(components.reshape(Q, -1).T)[0] for components in (ours, theirs)]
    return float(np.sqrt(max(0.0, 1.0 - np.linalg.svd(spans[0].T @ spans[1], compute_uv=False).min() ** 2)))
