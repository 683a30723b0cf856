"""Cyclic learning from complete data, beside scikit-fda's functional PCA of the same cycles.

Both are given N_SLICES cycles of 19 angles at 64 phases, made of five components that all angles share and noise, and
find the mean, those components and every cycle as they reconstruct it. scikit-fda knows curves of one angle; it finds
shared components when the angles' curves stand one after the other, as one long curve. Faster, but another result, is
one PCA for each angle by itself in as many Fourier functions as ours has; its figure is given too.
"""

from functools import partial
from importlib.util import find_spec

import numpy as np
from threadpoolctl import threadpool_limits

from analysis.benchmarks.figure import Figure, not_measured
from analysis.benchmarks.timing import fastest_s
from workbench.motion.models.functional_pca import Slices, fpca_paper
from workbench.utils.arrays import FloatArray

N_SLICES, N_PHASES, N_ANGLES, Q = 700, 64, 19, 5
NAMES = ("cyclic_vs_scikit_fda", "cyclic_vs_scikit_fda_each_angle")


def figures() -> list[Figure]:
    """How many times faster than scikit-fda: for the same result, and for one PCA for each angle."""
    if find_spec("skfda") is None:
        why = 'scikit-fda is not installed: pip install -e ".[bench]"'
        return [not_measured(name, "× faster", 1.0, "higher", why) for name in NAMES]
    slices = _complete(np.random.default_rng(0))
    with threadpool_limits(limits=1, user_api="blas"):
        ours, joint, single = fastest_s(
            [partial(fpca_paper, slices, Q), partial(_joint, slices.values), partial(_each_angle, slices.values)]
        )
        apart = _apart(fpca_paper(slices, Q).components, _joint(slices.values)[0])
    what = f"{N_SLICES} cycles × {N_PHASES} phases × {N_ANGLES} angles, one thread; ours {1e3 * ours:.0f} ms"
    same = f"scikit-fda, the same components to {apart:.1g}: {1e3 * joint:.0f} ms; {what}"
    other = f"scikit-fda, one PCA for each angle: {1e3 * single:.0f} ms; {what}"
    return [
        Figure(NAMES[0], joint / ours, "× faster", 1.0, "higher", same),
        Figure(NAMES[1], single / ours, "× faster", 1.0, "higher", other),
    ]


def _complete(rng: np.random.Generator) -> Slices:
    """Cycles of smooth curves: a mean, Q ways to vary from cycle to cycle, and noise."""
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
    """scikit-fda's components (Q, T, m) and reconstructed cycles (N, T, m), all angles as one curve."""
    from skfda import FDataGrid
    from skfda.preprocessing.dim_reduction import FPCA

    n, n_phases, m = values.shape
    curves = FDataGrid(values.transpose(0, 2, 1).reshape(n, -1), np.arange(n_phases * m) / n_phases)
    fpca = FPCA(n_components=Q, _weights=np.full(n_phases * m, 1.0 / n_phases))
    again = fpca.inverse_transform(fpca.fit_transform(curves))
    components, cycles = (
        found.data_matrix.reshape(-1, m, n_phases).transpose(0, 2, 1) for found in (fpca.components_, again)
    )
    return components, cycles


def _each_angle(values: FloatArray) -> FloatArray:
    """Cycles (N, T, m) as scikit-fda reconstructs them from Q components of each angle."""
    from skfda import FDataGrid
    from skfda.preprocessing.dim_reduction import FPCA
    from skfda.representation.basis import FourierBasis

    phases, again = np.arange(values.shape[1]) / values.shape[1], np.empty_like(values)
    for angle in range(values.shape[2]):
        curves = FDataGrid(values[:, :, angle], phases, domain_range=(0.0, 1.0))
        fpca = FPCA(n_components=Q)
        scores = fpca.fit_transform(curves.to_basis(FourierBasis((0.0, 1.0), n_basis=19)))
        again[:, :, angle] = fpca.inverse_transform(scores)(phases)[:, :, 0]
    return again


def _apart(ours: FloatArray, theirs: FloatArray) -> float:
    """The sine of the largest angle between what two sets of components (Q, T, m) span."""
    spans = [np.linalg.qr(part.reshape(Q, -1).T)[0] for part in (ours, theirs)]
    return float(np.sqrt(max(0.0, 1.0 - np.linalg.svd(spans[0].T @ spans[1], compute_uv=False).min() ** 2)))
