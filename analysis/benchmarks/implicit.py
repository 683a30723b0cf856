"""Paper C's database: speed and fidelity of the searches, and how well they predict motion that is not in it.

    python -m analysis.benchmarks.implicit --data DATA [--sizes 10000 100000 1000000]

DATA holds cmu/ and bandai/. The library is every Bandai clip but each tenth, and the CMU clips of all subjects but
35, 38 and 39; windows to search for come from what is left out. Larger libraries repeat the clips with noise.
Times are the minimum of the repeats, everything in one process and in turns, ours on numba's threads.

The searches. "sign tree" is the paper's, with leaves drawn uniformly or by p(c_i | c_t); "kd-tree (ours)" is what the
prior uses. The neighbours of cKDTree stand for a search that returns the k nearest and draws among them by p.

The predictions, all without noise, so that an error is that of the expected pose. What each is given of the past:
implicit: the window of d frames; the mean of N_PARTICLES draws, a search's and a prediction's kinds as named.
nearest neighbour: the same window, continued as the library's most similar one, angles copied.
cyclic: the last pose alone, from which `Cyclic.nearest` takes phase and coefficients; the phase's speed is the learned
mean. It knows walking only, from the library's clips called so, CMU's alone or Bandai's acted ones too; its misfit to
the last pose counts as error.
smooth: the last pose and its velocity over the last frame, kept up within the limits: constant velocity.
zero velocity: the last pose.
"""

import argparse
import resource
import time
from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import TypeVar

import numpy as np
from scipy.spatial import cKDTree
from tqdm import tqdm

from workbench.body.kinematics import joints
from workbench.body.skeleton import N_ROOT, POSE_NAMES, Skeleton, person_skeleton
from workbench.core.prior import Prior
from workbench.motion.models.cyclic_model import learn_cyclic
from workbench.motion.models.training import database_motions
from workbench.motion.models.windows import Windows, learn_windows
from workbench.motion.motion import Motion
from workbench.priors.cyclic import Cyclic
from workbench.priors.implicit import Implicit
from workbench.priors.implicit_search import KdTree, exact_log_prob, kd_tree, search
from workbench.priors.implicit_tree import Tree, draw, fidelity, median_tree, sign_tree, total_variation
from workbench.priors.smooth import SIGMA, Smooth
from workbench.utils.arrays import Float32Array, FloatArray

LEFT_OUT_PEOPLE = ("35", "38", "39")
RATE_HZ, N_PARENTS, N_CHILDREN, REPEATS = 30.0, 500, 20, 5
NEIGHBOURS = 10
BETAS = (0.01, 0.05, 0.1)
PREDICTION_BETA, N_PARTICLES, HORIZON, MAX_WINDOWS = 0.05, 50, 10, 150
CYCLIC_COMPONENTS = 8
T = TypeVar("T")
Predict = Callable[[FloatArray], FloatArray]


def main() -> None:
    options = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    options.add_argument("--data", type=Path, required=True, help="folder with cmu/ and bandai/")
    options.add_argument("--cache", default="~/.cache/workbench", help="folder for the imported motions")
    options.add_argument("--sizes", type=int, nargs="*", default=[10_000, 100_000, 1_000_000])
    arguments = options.parse_args()
    library, left_out = recorded(arguments.data, arguments.cache)
    _prediction_table(library, left_out)
    for size in arguments.sizes:
        _search_table(size, library, [motion for clips in left_out.values() for motion in clips])


def recorded(data: Path, cache: str) -> tuple[list[Motion], dict[str, list[Motion]]]:
    """The library's clips, and those left out by why they are."""
    motions = [motion.resampled(RATE_HZ) for motion in database_motions("recorded", data=str(data), cache=cache)]
    bandai = [motion for motion in motions if motion.subject.startswith("bandai")]
    cmu = _of_cmu(motions)
    people = [motion for motion in cmu if motion.subject in LEFT_OUT_PEOPLE]
    library = [m for i, m in enumerate(bandai) if i % 10] + [m for m in cmu if m.subject not in LEFT_OUT_PEOPLE]
    return library, {"people left out (CMU 35, 38, 39)": people, "clips left out (Bandai)": bandai[::10]}


def _of_cmu(motions: Sequence[Motion]) -> list[Motion]:
    return [motion for motion in motions if not motion.subject.startswith("bandai")]


def _search_table(size: int, library: Sequence[Motion], left_out: Sequence[Motion]) -> None:
    rng = np.random.default_rng(0)
    start = time.perf_counter()
    windows = learn_windows(enlarged(library, size, rng))
    took = time.perf_counter() - start
    others = learn_windows(left_out)
    probes = windows.project(others.window_rows(rng.choice(len(others), N_PARENTS, replace=False)))
    c = windows.coefficients
    held = (windows.rows, windows.ends, c)
    print(f"\nn = {len(windows)}, b = {c.shape[1]} ({100 * windows.explained:.0f} % of the variance), learned in")
    print(f"{took:.1f} s, {_megabytes(*held)}; {N_PARENTS} distinct parents, {N_PARENTS * N_CHILDREN} draws")
    (sign, signed), (median, halved), (kd, split) = (_timed(partial(f, c)) for f in (sign_tree, median_tree, kd_tree))
    neighbours, indexed = _timed(partial(cKDTree, c))
    print(
        f"built besides: sign tree {signed:.2f} s, {_megabytes(sign.rows, sign.order, sign.starts, sign.splits)};",
        end=" ",
    )
    print(f"median tree {halved:.2f} s, {_megabytes(median.rows, median.order, median.starts, median.splits)};")
    print(f"kd-tree {split:.2f} s, {_megabytes(kd.coefficients, kd.order, kd.leaf_boxes, kd.group_boxes)};", end=" ")
    print(f"cKDTree {indexed:.2f} s, {_megabytes(neighbours.data, neighbours.indices)} and its nodes")
    print(f"most memory this process has held: {resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024:.0f} MB")
    print("β     search            µs a draw   TV to exact   |c_i − c_t|²   visited %")
    for beta in BETAS:
        _print_rows(beta, c, probes, (sign, median, kd), neighbours, rng)


def _megabytes(*arrays: np.ndarray) -> str:
    return f"{sum(array.nbytes for array in arrays) / 1e6:.0f} MB"


def _print_rows(
    beta: float,
    c: Float32Array,
    probes: FloatArray,
    trees: tuple[Tree, Tree, KdTree],
    neighbours: cKDTree,
    rng: np.random.Generator,
) -> None:
    sign, median, kd = trees
    children, counts = np.repeat(probes, N_CHILDREN, axis=0), np.full(N_PARENTS, N_CHILDREN)
    uniforms = rng.random((len(children), c.shape[1] + 1))
    few = max(2, min(N_PARENTS, int(2e7 / len(c))))  # the slow ones search for fewer parents and are scaled up
    searches: dict[str, tuple[Callable[[], object], int]] = {
        "sign tree": (lambda: draw(sign, children, beta, uniforms, "uniform"), N_PARENTS),
        "sign tree, gauss": (lambda: draw(sign, children, beta, uniforms), N_PARENTS),
        "median tree": (lambda: draw(median, children, beta, uniforms), N_PARENTS),
        "kd-tree (ours)": (lambda: search(kd, probes, counts, beta, uniforms[:, 0]), N_PARENTS),
        "exact scan": (lambda: [_scan(c, probe, beta, uniforms[:N_CHILDREN, 0]) for probe in probes[:few]], few),
        f"cKDTree, k = {NEIGHBOURS}": (lambda: neighbours.query(probes[:few], k=NEIGHBOURS), few),
    }
    times = _fastest_us(searches)
    asked = probes[:30]
    report = partial(fidelity, coefficients=c, probes=asked, beta=beta, rng=rng)
    results = [report(sign, leaf="uniform"), report(sign), report(median), report(kd)]
    for (name, microseconds), result in zip(times.items(), results, strict=False):
        print(
            f"{beta:<6}{name:<18}{microseconds:>9.2f}{result.total_variation:>14.2g}"
            f"{result.distance:>15.1f}{100 * result.visited:>12.1f}"
        )
    exact, effective = results[-1].exact_distance, results[-1].effective
    print(f"{beta:<6}{'exact scan':<18}{times['exact scan']:>9.2f}{0.0:>14.2g}{exact:>15.1f}{100.0:>12.1f}")
    name = f"cKDTree, k = {NEIGHBOURS}"
    print(f"{beta:<6}{name:<18}{times[name]:>9.2f}{_neighbours_variation(neighbours, c, asked, beta):>14.2g}", end="")
    print(f"   (the exact p is spread over {effective:.0f} entries)")


def _scan(c: Float32Array, probe: FloatArray, beta: float, uniforms: FloatArray) -> object:
    odds = np.exp(exact_log_prob(c, probe, beta)).cumsum()
    return np.searchsorted(odds, uniforms * odds[-1])


def _neighbours_variation(neighbours: cKDTree, c: Float32Array, probes: FloatArray, beta: float) -> float:
    """Total variation when p is cut off after the k nearest neighbours."""
    variations = []
    for probe in probes:
        p = np.exp(exact_log_prob(c, probe, beta))
        nearest = neighbours.query(probe, k=NEIGHBOURS)[1]
        q = np.zeros_like(p)
        q[nearest] = p[nearest] / p[nearest].sum()
        variations.append(total_variation(p, q))
    return float(np.mean(variations))


def enlarged(library: Sequence[Motion], size: int, rng: np.random.Generator) -> list[Motion]:
    """Clips for about `size` windows: some of them, or all of them repeatedly with noise.

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


def _prediction_table(library: Sequence[Motion], left_out: dict[str, list[Motion]]) -> None:
    windows = learn_windows(library)
    walks = [motion for motion in library if motion.activity == "walk"]
    methods = _methods(windows, walks)
    for group, motions in left_out.items():
        tracks, skeletons = _tracks(motions, windows)
        past, future = tracks[:, : windows.length + 1], tracks[:, windows.length + 1 :]
        print(f"\n{group}: {len(tracks)} windows of {len(motions)} clips, n = {len(windows)}, β = {PREDICTION_BETA},")
        print(f"cyclic: {CYCLIC_COMPONENTS} components, {len(walks)} walks in all, {len(_of_cmu(walks))} of CMU")
        print(f"method                 1 frame: deg     mm    {HORIZON} frames: deg     mm")
        for name, predict in tqdm(methods.items(), disable=None, leave=False):
            predicted = predict(past)
            degrees = [np.degrees(np.sqrt(np.mean((predicted - future)[:, k, N_ROOT:] ** 2))) for k in (0, -1)]
            mm = [_joint_error_mm(skeletons, predicted[:, k], future[:, k]) for k in (0, -1)]
            tqdm.write(f"{name:<22}{degrees[0]:>13.2f}{mm[0]:>8.0f}{degrees[1]:>17.2f}{mm[1]:>8.0f}")


def _methods(windows: Windows, walks: Sequence[Motion]) -> dict[str, Predict]:
    still_root, still = dict.fromkeys(("sigma_position", "sigma_rotation"), (0.0,) * 3), dict.fromkeys(SIGMA, 0.0)

    def implicit(beta: float = PREDICTION_BETA, **options: str) -> Predict:
        prior = Implicit(windows, beta=beta, sigma_angles=0.0, **still_root, **options)
        return lambda past: _rolled_out(prior, np.array([prior.start_after(poses, N_PARTICLES) for poses in past]))

    def cyclic(known: Sequence[Motion]) -> Predict:
        model = learn_cyclic(known, CYCLIC_COMPONENTS)
        prior = Cyclic(model, sigma_coefficients=0.0, sigma_phase=0.0, sigma_phase_speed=0.0, **still_root)
        return lambda past: _rolled_out(prior, np.array([[prior.nearest(poses[-1])] for poses in past]))

    smooth = Smooth(sigma=still, sigma_velocity=still)
    return {
        "implicit, copy": implicit(prediction="copy"),
        "implicit, increment": implicit(prediction="increment"),
        "implicit, blend": implicit(),
        "sign tree, copy": implicit(prediction="copy", search="sign_tree"),
        "cyclic, CMU's walks": cyclic(_of_cmu(walks)),
        "cyclic, all walks": cyclic(walks),
        "smooth": lambda past: _rolled_out(smooth, smooth.enter(past[:, -1], RATE_HZ * (past[:, -1] - past[:, -2]))),
        "nearest neighbour": implicit(1e-9, prediction="copy"),
        "zero velocity": lambda past: np.repeat(past[:, -1:], HORIZON, axis=1),
    }


def _tracks(motions: Sequence[Motion], windows: Windows) -> tuple[FloatArray, list[Skeleton]]:
    """Up to MAX_WINDOWS stretches (W, d + 1 + HORIZON, P) of the motions, evenly chosen, and their people."""
    length = windows.length + 1 + HORIZON
    found = [(m, s) for m in motions for s in range(0, len(m) - length + 1, 10)]
    found = found[:: max(1, -(-len(found) // MAX_WINDOWS))]
    return np.array([m.poses[s : s + length] for m, s in found]), [person_skeleton(m.shape) for m, _ in found]


def _rolled_out(prior: Prior, starts: FloatArray) -> FloatArray:
    """The expected poses (W, HORIZON, P) after states (W, N, D), or (W, D) one for each window."""
    rng = np.random.default_rng(0)
    state, expected = starts.reshape(-1, starts.shape[-1]), []
    for _ in range(HORIZON):
        state = prior.step(state, 1.0 / RATE_HZ, rng)
        expected.append(prior.pose(state).reshape(len(starts), -1, len(POSE_NAMES)).mean(axis=1))
    return np.stack(expected, axis=1)


def _joint_error_mm(skeletons: Sequence[Skeleton], predicted: FloatArray, true: FloatArray) -> float:
    apart = [joints(s, p[None]) - joints(s, t[None]) for s, p, t in zip(skeletons, predicted, true, strict=True)]
    return 1e3 * float(np.linalg.norm(np.concatenate(apart), axis=-1).mean())


def _timed(build: Callable[[], T]) -> tuple[T, float]:
    build()  # compiles
    start = time.perf_counter()
    return build(), time.perf_counter() - start


def _fastest_us(searches: dict[str, tuple[Callable[[], object], int]]) -> dict[str, float]:
    """Fastest run of each search, µs a draw; they take turns, after one round that compiles and fills caches."""
    times = np.empty((REPEATS + 1, len(searches)))
    for repeat in tqdm(times, disable=None, leave=False):
        for column, (function, _) in enumerate(searches.values()):
            start = time.perf_counter()
            function()
            repeat[column] = time.perf_counter() - start
    fastest = times[1:].min(axis=0)
    return {
        name: 1e6 * float(t) / (parents * N_CHILDREN)
        for (name, (_, parents)), t in zip(searches.items(), fastest, strict=True)
    }


if __name__ == "__main__":
    main()
