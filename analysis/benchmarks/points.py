"""Fitting points: accuracy against time of every inference, and what the automatic start recovers from.

    python -m analysis.benchmarks.points [DATA]

DATA: the folder with cmu/ and bandai/; without it a generated walk and a model of generated walkers. The first table
fits the same points (400 a frame, σ 2 cm at 4 m, 15 % outliers, 14 Hz) of one walk, not learned from, by every
inference: error over SEEDS draws of the points, milliseconds a frame, likelihood or residual evaluations of a frame.
The second starts 40 walks and runs with phases wrong by half a cycle and a speed wrong by 20 %, as if set by hand, and
counts how many are held: where the joints are off by less than HELD_MM in the mean. One process, one thread of BLAS.
"""

import sys
import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import TypeAlias

import numpy as np
from threadpoolctl import threadpool_limits
from tqdm import tqdm

from analysis.benchmarks.machine import processor, versions
from workbench.body.limbs import Body, person
from workbench.datasets.points import Points
from workbench.evaluation.pose_errors import step_errors
from workbench.inference.least_squares.frame_by_frame import FrameByFrame
from workbench.inference.least_squares.least_squares import LeastSquares
from workbench.inference.least_squares.motion_fit import MotionFit
from workbench.inference.smc.hybrid import Hybrid
from workbench.inference.smc.particle_filter import ParticleFilter
from workbench.likelihoods.surface_points import SurfacePoints
from workbench.priors.activity import Activity
from workbench.priors.from_motions import activity

SEEDS, TRIALS, HELD_MM = 5, 40, 40.0
WALKS = ("dataset-2_walk_normal_001", "dataset-1_walk_feminine_001", "dataset-2_walk_youthful_005")
RUNS = ("dataset-1_run_tired_001", "dataset-2_run_elderly_005", "dataset-2_run_normal_022")

Method: TypeAlias = LeastSquares | ParticleFilter | Hybrid


@dataclass(frozen=True)
class Source:
    """Where clips and what is learned come from. cache: for models that can be learned again."""

    data: str | None
    cache: str

    @property
    def walks(self) -> Sequence[str]:
        return ("builtin",) if self.data is None else WALKS

    @property
    def runs(self) -> Sequence[str]:
        return ("builtin_run",) if self.data is None else RUNS

    def prior(self, n_components: int) -> Activity:
        """A prior learned from everything but the clips that are tracked here."""
        motions, out = ("builtin", []) if self.data is None else ("recorded", [*WALKS, *RUNS])
        return activity(
            motions=motions, data=self.data, cache=self.cache, leave_out=out, n_components=n_components
        )  # fmt: skip


def main() -> None:
    source = Source(sys.argv[1] if len(sys.argv) > 1 else None, "~/.cache/workbench")
    print(f"{processor()}; {versions()}\n")
    with threadpool_limits(limits=1, user_api="blas"):
        _print_methods(source)
        _print_starts(source)


def _print_methods(source: Source) -> None:
    print(f"{'method':<40}{'error mm':>10}{'worst':>8}{'ms a frame':>12}{'evaluations':>13}")
    dataset = Points(motion=source.walks[0], data=source.data, first_frame=10)
    body = person(dataset.known.shape)
    for name, inference, given in _methods(source, body):
        errors, times, evaluations = [], [], 0.0
        for seed in tqdm(range(SEEDS), desc=name, disable=None, leave=False):
            points = replace(dataset, seed=seed, start="given" if given else "auto")
            error, seconds, evaluations = _track(inference, points, body, seed)
            errors.append(error)
            times.append(seconds)
        print(f"{name:<40}{np.mean(errors):>10.1f}{max(errors):>8.1f}{1e3 * min(times):>12.1f}{evaluations:>13.0f}")


def _methods(source: Source, body: Body) -> Iterator[tuple[str, Method, bool]]:
    """Name, inference, and whether it is given the start."""
    full, small, likelihood = source.prior(30), source.prior(8), SurfacePoints(body)
    fit = partial(LeastSquares, body, likelihood)
    yield "least squares, style per frame", fit(full), False
    yield "least squares, steady", fit(full, problem=MotionFit(frames_per_style=None)), False
    yield "least squares, no model", fit(problem=FrameByFrame()), True
    yield "least squares, Gaussian of poses", fit(full, problem=FrameByFrame(pose_prior=True)), True
    for n in (30, 100, 300, 1000, 3000):
        yield f"particle filter, {n}", ParticleFilter(small, likelihood, n_particles=n), True
    tempered = ParticleFilter(small, SurfacePoints(body, temper=0.3), n_particles=500)
    yield "hybrid, 500", Hybrid(tempered, fit(small), widen=2.0), False


def _track(inference: Method, dataset: Points, body: Body, seed: int) -> tuple[float, float, float]:
    """Mean joint error, mm, without the first frame; seconds and evaluations a frame, recording and errors left out."""
    streams = dict(zip(("start", "resampling", "prior"), np.random.default_rng(seed).spawn(3), strict=True))
    frames = list(dataset.frames())
    began = time.perf_counter()
    steps = list(inference.run(frames, dataset.known.start_pose, streams))
    seconds = (time.perf_counter() - began) / len(frames)
    errors = [step_errors(step, body)["error_abs_mm"] for step in steps]
    iterations = steps[-1].diagnostics.get("iterations", 0.0)
    particles = 0 if isinstance(inference, LeastSquares) else inference.n_particles or 0
    return float(np.mean(errors[1:])), seconds, iterations + particles


def _print_starts(source: Source) -> None:
    prior = source.prior(30)
    held = {"wrong phases as given": 0, "automatic start": 0}
    clips = [*source.walks, *source.runs]
    for trial in tqdm(range(TRIALS), desc="starts", disable=None, leave=False):
        dataset = Points(motion=clips[trial % len(clips)], data=source.data, first_frame=10, start="given", seed=trial)
        wrong = _wrong(dataset.known.phase_ends, np.random.default_rng(trial))
        for name, phases in (("wrong phases as given", wrong), ("automatic start", None)):
            body = person(dataset.known.shape)
            shown = dataset if phases else replace(dataset, start="auto")
            fit = LeastSquares(body, SurfacePoints(body), prior, problem=MotionFit(phases=phases))
            error, _, _ = _track(fit, shown, body, trial)
            held[name] += error < HELD_MM
    print(f"\nphases off by half a cycle, speed by 20 %: held of {TRIALS} trials over {len(clips)} clips")
    for name, count in held.items():
        print(f"{name:<40}{count:>10}")


def _wrong(ends: tuple[float, float] | None, rng: np.random.Generator) -> tuple[float, float]:
    """Phases half a cycle off at the start, that run 20 % too fast or too slow."""
    assert ends is not None
    first, speed = ends[0] + 0.5, (ends[1] - ends[0]) * (1.0 + 0.2 * rng.choice([-1.0, 1.0]))
    return first, first + float(speed)


if __name__ == "__main__":
    main()
