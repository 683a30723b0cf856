"""Draws of the implicit prior: by the paper's tree and from the exact p(c_i | c_t), against scipy's kd-tree.

The database is that of `analysis.benchmarks.implicit`, from the recordings in $WORKBENCH_DATA; where that is not set,
the generated walkers' and runners' clips with noise. The tree's probes are all different, so that no draw profits
from another; the exact search draws N_CHILDREN for each of N_PARENTS, as a filter's particles do.
"""

import os
from collections.abc import Sequence
from functools import partial
from pathlib import Path

import numba
import numpy as np
from scipy.spatial import cKDTree

from analysis.benchmarks.figure import Figure
from analysis.benchmarks.implicit import N_CHILDREN, N_PARENTS, NEIGHBOURS, RATE_HZ, enlarged, recorded
from analysis.benchmarks.timing import fastest_s
from workbench.motion.models.training import database_motions
from workbench.motion.models.windows import learn_windows
from workbench.motion.motion import Motion
from workbench.priors.implicit_search import kd_tree, search
from workbench.priors.implicit_tree import draw, fidelity, sign_tree
from workbench.utils.arrays import Float32Array, FloatArray

BETA, N_DRAWS, N_QUERIES, REPEATS = 0.05, N_PARENTS * N_CHILDREN, 20, 60
SMALL, MEDIUM, LARGE = 10_000, 100_000, 1_000_000


def tree_figures() -> list[Figure]:
    """The paper's tree: its time, how that grows with the database, and a search for nearest neighbours beside it."""
    source, library, others = motions()
    times = {}
    for size in (SMALL, LARGE):
        c, probes = database(size, library, others, N_DRAWS)
        tree, uniforms = sign_tree(c), np.random.default_rng(1).random((N_DRAWS, c.shape[1] + 1))
        timed = [partial(draw, tree, probes, BETA, uniforms, leaf) for leaf in ("uniform", "gaussian")]
        times[size] = [1e6 * seconds / N_DRAWS for seconds in fastest_s(timed, REPEATS)]
    queries = partial(cKDTree(c).query, probes[:N_QUERIES], k=NEIGHBOURS)
    neighbours = 1e6 * fastest_s([queries], repeats=10)[0] / N_QUERIES
    (small, small_gaussian), (large, large_gaussian) = times[SMALL], times[LARGE]
    what = f"{source}, n = {LARGE}, {N_DRAWS} different probes, β = {BETA}, one thread"
    return [
        Figure("tree_draw_us", large, "µs a draw", 1.2, "lower", f"paper C's tree, equal odds in a leaf; {what}"),
        Figure("tree_draw_growth", large / small, "×", 2.2, "lower", f"against n = {SMALL}: {small:.2f} µs"),
        Figure(
            "tree_draw_gaussian_us", large_gaussian, "µs a draw", 1.2, "lower",
            f"the same, p(c_i | c_t) in a leaf; {small_gaussian:.2f} µs at n = {SMALL}",
        ),
        Figure(
            "tree_vs_ckdtree", neighbours / large, "× faster", 100.0, "higher",
            f"scipy's cKDTree, k = {NEIGHBOURS}: {neighbours:.0f} µs a query",
        ),
    ]  # fmt: skip


def exact_figures() -> list[Figure]:
    """The exact search at the prior's default temperature, and how exact it is."""
    source, library, others = motions()
    c, probes = database(MEDIUM, library, others, N_PARENTS)
    tree, counts = kd_tree(c), np.full(N_PARENTS, N_CHILDREN)
    uniforms, threads = np.random.default_rng(1).random(N_DRAWS), numba.get_num_threads()
    seconds = fastest_s([partial(search, tree, probes, counts, BETA, uniforms)], REPEATS)[0]
    apart = fidelity(tree, c, probes[:30], BETA, np.random.default_rng(2)).total_variation
    return [
        Figure(
            "exact_draw_us", 1e6 * seconds / N_DRAWS, "µs a draw", 5.0, "lower",
            f"{source}, n = {MEDIUM}, {N_PARENTS} parents, β = {BETA}, {threads} threads; "
            f"total variation to p {apart:.1g}",
        )
    ]  # fmt: skip


def motions() -> tuple[str, Sequence[Motion], Sequence[Motion]]:
    """What they are, the library's clips, and clips to take probes from."""
    cache = os.environ.get("WORKBENCH_CACHE", "~/.cache/workbench")
    if data := os.environ.get("WORKBENCH_DATA"):
        library, left_out = recorded(Path(data), cache)
        return "recorded people", library, [motion for motions in left_out.values() for motion in motions]
    generated = database_motions("builtin", data=None, cache=cache)
    resampled = [motion.resampled(RATE_HZ) for motion in generated]
    return "generated people", [m for i, m in enumerate(resampled) if i % 10], resampled[::10]


def database(
    size: int, library: Sequence[Motion], others: Sequence[Motion], n_probes: int
) -> tuple[Float32Array, FloatArray]:
    """The coefficients (n, b) of a library of about `size` windows, and probes (K, b) from other clips."""
    rng = np.random.default_rng(0)
    windows = learn_windows(enlarged(library, size, rng))
    unknown = learn_windows(others)
    if len(unknown) < n_probes:
        unknown = learn_windows(enlarged(others, n_probes, rng))
    return windows.coefficients, windows.project(unknown.window_rows(rng.choice(len(unknown), n_probes, replace=False)))
