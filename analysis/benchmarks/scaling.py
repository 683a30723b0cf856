"""How time and memory grow with the size of the problem, and the exponents of their power laws.

    python -m analysis.benchmarks.scaling [NAME…] [--out FOLDER] [--json FILE]

Without a NAME everything is measured, in about ten minutes and two gigabytes. --out draws a figure for each NAME, for
which it needs the extra `report`. The likelihood is that of image motion, of N_PARTICLES particles, 12 limbs, N_SAMPLES
points a limb and 640×480 px where these do not vary. Everything runs on all cores, and the fastest of some runs counts,
by the clock: close other programs. An exponent is fitted to the upper half of the sizes.
"""

import argparse
import os
import sys
import tempfile
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import TypeVar

import numpy as np
from threadpoolctl import threadpool_limits
from tqdm import tqdm

from analysis.benchmarks import draws, length, memory, step
from analysis.benchmarks.curve import Curve, told, write_curves
from analysis.benchmarks.implicit import N_CHILDREN, N_PARENTS
from analysis.benchmarks.likelihood import N_PARTICLES, N_SAMPLES, people, scene
from analysis.benchmarks.machine import cores, processor, versions
from analysis.benchmarks.timing import fastest_s
from workbench.body.limbs import Limbs, person
from workbench.core.frame import Frame
from workbench.core.prior import Prior
from workbench.datasets.points import Points
from workbench.inference.least_squares.least_squares import LeastSquares
from workbench.likelihoods.image_motion import ImageMotion
from workbench.likelihoods.surface_points import SurfacePoints
from workbench.priors.from_motions import activity
from workbench.priors.implicit_search import kd_tree, search
from workbench.priors.implicit_tree import draw, sign_tree
from workbench.utils.arrays import FloatArray
from workbench.utils.errors import InputError

REPEATS, REPEATS_OF_LONG = 12, 4
"""Runs of each function, of which the fastest counts; they take turns, so that other load hits all sizes alike."""
NOISE_GB = 0.02
"""Peaks of equal runs differ by up to 0.01 at 10⁴ particles and 0.024 at 10⁵ (measured)."""
T = TypeVar("T")
PARTICLES = (100, 1_000, 10_000, 100_000, 1_000_000)
STEP_PARTICLES = (100, 300, 1_000, 3_000, 10_000, 30_000, 100_000)
CUES_PARTICLES = (100, 300, 1_000, 3_000, 10_000, 30_000)
LENGTHS = (50, 150, 500, 1_500, 5_000)
MEMORY_PARTICLES = (100, 1_000, 10_000, 30_000, 100_000, 300_000, 1_000_000)


def particles(
    sizes: Sequence[int] = PARTICLES, step_sizes: Sequence[int] = STEP_PARTICLES,
    cues_sizes: Sequence[int] = CUES_PARTICLES,
) -> list[Curve]:  # fmt: skip
    """The likelihood alone, and the whole step, recorded, of the default experiment and of several cues."""
    seen = scene(np.random.default_rng(0), N_SAMPLES)
    alone = _fastest_ms([_likelihood(*seen, n) for n in sizes], REPEATS_OF_LONG)
    whole = [step.fastest(n, max(1, min(4, 30_000 // n))).whole for n in _bar(step_sizes, "step")]
    cues = [step.fastest(n, max(1, min(4, 9_000 // n)), *step.several_cues()).whole for n in _bar(cues_sizes, "cues")]
    return [
        _curve("whole step", "particles", "ms a frame", step_sizes, whole),
        _curve("several cues", "particles", "ms a frame", cues_sizes, cues),
        _curve("likelihood alone", "particles", "ms a frame", sizes, alone),
    ]


def memory_of_particles(sizes: Sequence[int] = MEMORY_PARTICLES) -> list[Curve]:
    """The default experiment's peak memory, recorded, and what of it hardly a particle would not take."""
    bare, *peaks = memory.peaks_gb((memory.FEW, *sizes))
    above = {size: peak - bare for size, peak in zip(sizes, peaks, strict=True) if peak > bare + NOISE_GB}
    curves = [_curve("peak memory", "particles", "GB", sizes, peaks)]
    if len(above) > 1:
        curves.append(_curve(f"beyond {memory.FEW} particles", "particles", "GB", [*above], [*above.values()]))
    return curves


def memory_of_length(sizes: Sequence[int] = LENGTHS) -> list[Curve]:
    """The default experiment's peak memory with hardly a particle, recorded, over the frames of its clip."""
    return [_curve("peak memory", "frames of the clip", "GB", sizes, length.peaks_gb(sizes))]


def clip_length(sizes: Sequence[int] = LENGTHS) -> list[Curve]:
    """The default experiment with hardly a particle, recorded, over the frames of its clip."""
    with tempfile.TemporaryDirectory() as folder:
        length.run_ms(2, Path(folder))  # compiles
        times = [length.run_ms(size, Path(folder)) for size in _bar(sizes, "length")]
    return [_curve("whole step", "frames of the clip", "ms a frame", sizes, times)]


def limbs(sizes: Sequence[int] = (1, 2, 4, 6, 8, 10, 12), n_particles: int = N_PARTICLES) -> list[Curve]:
    """The likelihood of the person's first limbs: torso, head, then one side's arm and leg, then the other's.

    The kinematics are always those of the whole skeleton. Every limb may hide every other.
    """
    likelihood, before, now = scene(np.random.default_rng(0), N_SAMPLES)
    body = likelihood.body
    parts = [replace(likelihood, body=replace(body, limbs=_first(body.limbs, size))) for size in sizes]
    times = _fastest_ms([_likelihood(part, before, now, n_particles) for part in parts], REPEATS)
    return [_curve("likelihood", "limbs", "ms a frame", sizes, times)]


def samples(sizes: Sequence[int] = (10, 20, 50, 100, 200), n_particles: int = N_PARTICLES) -> list[Curve]:
    """The likelihood with that many points a limb."""
    likelihood, before, now = scene(np.random.default_rng(0), N_SAMPLES)
    each = [_likelihood(replace(likelihood, n_samples=size), before, now, n_particles) for size in sizes]
    return [_curve("likelihood", "points a limb", "ms a frame", sizes, _fastest_ms(each, REPEATS))]


def pixels(scales: Sequence[float] = (0.25, 0.5, 1.0, 2.0, 3.0), n_particles: int = N_PARTICLES) -> list[Curve]:
    """The likelihood, and what it does once with an image, of 640×480 px times these scales."""
    sizes, times = [], []
    for scale in _bar(scales, "pixels"):
        likelihood, before, now = scene(np.random.default_rng(0), N_SAMPLES, scale)
        view = now.views[0]
        looking = _likelihood(likelihood, before, now, n_particles)
        times.append(_fastest_ms([looking, partial(likelihood.look, None, now)], REPEATS))
        sizes.append(1e-6 * view.image.size)
    size, (looking_ms, preparing_ms) = "image size, 10⁶ px", zip(*times, strict=True)
    return [
        _curve("likelihood", size, "ms a frame", sizes, looking_ms),
        _curve("preparing the image", size, "ms a frame", sizes, preparing_ms),
    ]


def database(sizes: Sequence[int] = (1_000, 10_000, 100_000, 1_000_000)) -> list[Curve]:
    """Draws of the implicit prior from random parts of one database: by the paper's tree, and exactly.

    As in `analysis.benchmarks.draws`: all the tree's probes are different, the exact search draws N_CHILDREN for each.
    """
    n_draws, rng = draws.N_DRAWS, np.random.default_rng(1)
    _, library, others = draws.motions()
    c, probes = draws.database(max(sizes), library, others, n_draws)
    uniforms, order = rng.random((n_draws, c.shape[1] + 1)), rng.permutation(len(c))
    counts, one_each = np.full(N_PARENTS, N_CHILDREN), np.ascontiguousarray(uniforms[:, 0])
    parts = [c[order[:size]] for size in sizes]
    paper = [partial(draw, sign_tree(part), probes, draws.BETA, uniforms, "uniform") for part in parts]
    exact = [partial(search, kd_tree(part), probes[:N_PARENTS], counts, draws.BETA, one_each) for part in parts]
    times = [1e3 * ms / n_draws for ms in _fastest_ms([*exact, *paper], REPEATS)]
    return [
        _curve("exact search", "windows in the database", "µs a draw", sizes, times[: len(sizes)]),
        _curve("paper C's tree", "windows in the database", "µs a draw", sizes, times[len(sizes) :]),
    ]


def frames(sizes: Sequence[int] = (7, 14, 28, 56, 112)) -> list[Curve]:
    """Least squares over all frames of a walk on a circle, 400 points a frame, a style per frame, from D's start.

    How often a fit is evaluated varies from walk to walk; so the time of one evaluation is told beside.
    """
    cache = os.environ.get("WORKBENCH_CACHE", "~/.cache/workbench")
    prior = activity(motions="builtin", data=None, cache=cache, n_components=30)
    evaluations_ms: list[list[float]] = [[] for _ in sizes]
    fits = [partial(_fit, *_walk(prior, n), kept) for n, kept in zip(sizes, evaluations_ms, strict=True)]
    whole, single = _fastest_ms(fits, REPEATS_OF_LONG), [min(kept) for kept in evaluations_ms]
    return [
        _curve("whole fit", "frames", "ms", sizes, whole),
        _curve("one evaluation", "frames", "ms", sizes, single),
    ]


MEASURES: Mapping[str, Callable[[], list[Curve]]] = {
    "time_against_particles": particles,
    "memory_against_particles": memory_of_particles,
    "time_against_length": clip_length,
    "memory_against_length": memory_of_length,
    "time_against_limbs": limbs,
    "time_against_samples": samples,
    "time_against_pixels": pixels,
    "time_against_database": database,
    "time_against_frames": frames,
}
"""What measures each NAME."""


def _fastest_ms(timed: Sequence[Callable[[], object]], repeats: int) -> list[float]:
    return [1e3 * seconds for seconds in fastest_s(timed, repeats)]


def _likelihood(likelihood: ImageMotion, before: Frame, now: Frame, n_particles: int) -> Callable[[], object]:
    rng = np.random.default_rng(1)
    return partial(likelihood.look(before, now).evaluate, people(rng, n_particles), people(rng, n_particles))


def _walk(prior: Prior, n_frames: int) -> tuple[LeastSquares, list[Frame], FloatArray | None]:
    """What fits a walk, its frames, and the start that paper D sets by hand."""
    dataset = Points(motion="builtin", path="circle", n_frames=n_frames, start="given", exact=True)
    known = dataset.known
    body = person(known.shape)
    inference = LeastSquares(body, SurfacePoints(body), prior, known.phase_ends)
    return inference, list(dataset.frames()), known.start_pose


def _fit(inference: LeastSquares, seen: Sequence[Frame], start: FloatArray | None, evaluation_ms: list[float]) -> None:
    fit = inference.fit_frames(seen, start, np.random.default_rng(0))[0]
    evaluation_ms.append(1e3 * fit.timing_s["least_squares"] / fit.iterations)


def _first(limbs: Limbs, n: int) -> Limbs:
    arrays = {name: getattr(limbs, name)[:n] for name in ("names", "joints", "starts", "ends", "radii", "spheres")}
    return replace(limbs, **arrays)


def _bar(sizes: Sequence[T], name: str) -> "tqdm[T]":
    return tqdm(sizes, desc=name, disable=None, leave=False)


def _curve(name: str, size: str, unit: str, sizes: Sequence[float], values: Sequence[float]) -> Curve:
    return Curve(name, size, unit, tuple(sizes), tuple(values))


def main(arguments: Sequence[str] | None = None) -> int:
    """Exit code 0, 2 for bad input."""
    parser = argparse.ArgumentParser(
        prog="python -m analysis.benchmarks.scaling",
        description=__doc__,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("names", nargs="*", metavar="NAME", help=f"of {', '.join(MEASURES)}; none: all")
    parser.add_argument("--out", type=Path, metavar="FOLDER", help="draw the figures here, as PNG")
    parser.add_argument("--json", type=Path, metavar="FILE", help="write the curves here")
    given = parser.parse_args(arguments)
    try:
        print(f"{processor()}, {cores()} cores; {versions()}")
        curves = measure(given.names or list(MEASURES), given.out)
        if given.json:
            write_curves(given.json, curves)
    except InputError as error:
        print(f"scaling: {error}", file=sys.stderr)
        return 2
    return 0


def measure(names: Sequence[str], out: Path | None) -> list[Curve]:
    """All curves of these names, printed and drawn as they come; raises InputError before anything is measured."""
    if unknown := [name for name in names if name not in MEASURES]:
        raise InputError(f"{unknown[0]}: expected one of {', '.join(MEASURES)}")
    curves: list[Curve] = []
    with threadpool_limits(limits=1, user_api="blas"):
        for name in names:
            found = MEASURES[name]()
            print("", name, *map(told, found), sep="\n", flush=True)
            curves += found
            if out is not None:
                from analysis.benchmarks.scaling_figures import write

                write(out, name, found)
    return curves


if __name__ == "__main__":
    sys.exit(main())
