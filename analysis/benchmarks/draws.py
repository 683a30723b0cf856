"""Draws of the implicit prior: by the paper's tree and from the exact p(c_i | c_t), against scipy's kd-tree.

The database is made of the recordings in $WORKBENCH_DATA, every Bandai clip but each tenth and the CMU clips of all
subjects but 35, 38 and 39, and repeats them with noise where it is larger; where that is not set, it is made of
generated walkers and runners. Windows to search for come from the clips left out. The tree's probes are all different,
so that no draw profits from another; the exact search draws N_CHILDREN for each of N_PARENTS, as a filter does.
"""

import os
from collections.abc import Sequence
from dataclasses import replace
from functools import partial

import numba
import numpy as np
from scipy.spatial import cKDTree

from analysis.benchmarks.figure import Figure
from analysis.benchmarks.measuring import fastest_s
from workbench.body.skeleton import N_ROOT
from workbench.motion.models.training import database_motions
from workbench.motion.models.windows import learn_windows
from workbench.motion.pose_sequence import Motion
from workbench.priors.implicit_search import kd_tree, search
from workbench.priors.implicit_tree import draw, fidelity, sign_tree
from workbench.utils.arrays import Float32Array, FloatArray

LEFT_OUT_PEOPLE = ("35", "38", "39")
RATE_HZ, N_PARENTS, N_CHILDREN, NEIGHBOURS = 30.0, 500, 20, 10
BETA, N_DRAWS, N_QUERIES, REPEATS = 0.05, N_PARENTS * N_CHILDREN, 20, 60
SMALL, MEDIUM, LARGE = 10_000, 100_000, 1_000_000


def tree_figures() -> list[Figure]:
    """Measure a draw by the paper's tree, and a search for nearest neighbours."""
    source, library, others = motions()
    times = {}
    for size in (SMALL, LARGE):
        c, probes = database(size, library, others, N_DRAWS)
        tree, uniforms = sign_tree(c), np.random.default_rng(1).random((N_DRAWS, c.shape[1] + 1))
        times[size] = 1e6 * fastest_s([partial(draw, tree, probes, BETA, uniforms, "uniform")], REPEATS)[0] / N_DRAWS
    queries = partial(cKDTree(c).query, probes[:N_QUERIES], k=NEIGHBOURS)
    neighbours = 1e6 * fastest_s([queries], repeats=10)[0] / N_QUERIES
    return [
        Figure(
            "tree_draw_us", times[LARGE], "µs a draw", 1.2, "lower",
            f"paper C's tree, equal odds in a leaf; {source}, n = {LARGE}, {N_DRAWS} different probes, β = {BETA}, one "
            f"thread; {times[SMALL]:.2f} µs at n = {SMALL}",
        ),
        Figure(
            "tree_vs_ckdtree", neighbours / times[LARGE], "× faster", 100.0, "higher",
            f"scipy's cKDTree, k = {NEIGHBOURS}: {neighbours:.0f} µs a query",
        ),
    ]  # fmt: skip


def exact_figures() -> list[Figure]:
    """Measure the exact search at the prior's default temperature, and how exact it is."""
    source, library, others = motions()
    c, probes = database(MEDIUM, library, others, N_PARENTS)
    tree, counts = kd_tree(c), np.full(N_PARENTS, N_CHILDREN)
    uniforms, threads = np.random.default_rng(1).random(N_DRAWS), numba.get_num_threads()
    seconds = fastest_s([partial(search, tree, probes, counts, BETA, uniforms)], REPEATS)[0]
    total_variation = fidelity(tree, c, probes[:30], BETA, np.random.default_rng(2)).total_variation
    return [
        Figure(
            "exact_draw_us", 1e6 * seconds / N_DRAWS, "µs a draw", 5.0, "lower",
            f"{source}, n = {MEDIUM}, {N_PARENTS} parents, β = {BETA}, {threads} threads; "
            f"total variation to p {total_variation:.1g}",
        )
    ]  # fmt: skip


def motions(data: str | None = os.environ.get("WORKBENCH_DATA")) -> tuple[str, Sequence[Motion], Sequence[Motion]]:
    """Return what they are, the library's clips, and clips to take probes from."""
    cache = os.environ.get("WORKBENCH_CACHE", "~/.cache/workbench")
    motions = database_motions("recorded" if data else "builtin", data=data, cache=cache)
    every = [motion.resampled(RATE_HZ) for motion in motions]
    people = [motion for motion in every if data and motion.subject in LEFT_OUT_PEOPLE]
    others = [*people, *[motion for motion in every if not data or motion.subject.startswith("bandai")][::10]]
    library = [motion for motion in every if motion not in others]
    return "recorded people" if data else "generated people", library, others


def database(
    size: int, library: Sequence[Motion], others: Sequence[Motion], n_probes: int
) -> tuple[Float32Array, FloatArray]:
    """Return the coefficients (n, b) of a library of about `size` windows, and probes (K, b) from other clips."""
    rng = np.random.default_rng(0)
    windows = learn_windows(enlarged(library, size, rng))
    probe_windows = learn_windows(others)
    if len(probe_windows) < n_probes:
        probe_windows = learn_windows(enlarged(others, n_probes, rng))
    return windows.coefficients, windows.project(
        probe_windows.window_rows(rng.choice(len(probe_windows), n_probes, replace=False))
    )


def enlarged(library: Sequence[Motion], size: int, rng: np.random.Generator) -> list[Motion]:
    """Return clips for about `size` windows: some of them, or all of them repeatedly with noise.

    A repeated clip is held differently by 3° in every angle, and every frame is off by another 0.1°.
    """
    motions: list[Motion] = []
    n_windows, order = 0, rng.permutation(len(library))
    while n_windows < size:
        motion = library[order[len(motions) % len(library)]]
        if len(motions) >= len(library):
            poses = motion.poses.copy()
            poses[:, N_ROOT:] += np.radians(3.0) * rng.standard_normal(poses.shape[1] - N_ROOT)
            poses[:, N_ROOT:] += np.radians(0.1) * rng.standard_normal((len(poses), poses.shape[1] - N_ROOT))
            motion = replace(motion, poses=poses)
        motions.append(motion)
        n_windows += max(0, len(motion) - 11)
    return motions
