"""Time of the whole step: tracking, errors and recording, as `workbench` runs the default experiment or walk_best.

What is done once (imports, rendering the scene, compiling, writing the file's end) is left out. The fastest of the
repeats counts; it is by the clock, and so wants a quiet machine.
"""

import os
import tempfile
import warnings
from dataclasses import dataclass
from pathlib import Path
from time import perf_counter

import numba
from hydra import compose, initialize_config_module
from omegaconf import DictConfig
from threadpoolctl import threadpool_limits
from tqdm import trange

from analysis.benchmarks.figure import Figure
from workbench.experiment.config.schema import prepare_hydra
from workbench.experiment.run import record, recorder_of
from workbench.experiment.summary import Summary
from workbench.experiment.tracking import Parts, assemble

N_FRAMES, REPEATS = 50, 10


@dataclass(frozen=True)
class Times:
    """Milliseconds a frame: of the whole loop, and of its stages."""

    whole: float
    stages: dict[str, float]


def speed_figures() -> list[Figure]:
    """Frames a second of 10⁴ particles, recorded."""
    times = fastest(10_000, REPEATS)
    return [Figure("step_fps", 1e3 / times.whole, "frames/s", 35.0, "higher", f"10000 particles: {_told(times)}")]


def recording_figures() -> list[Figure]:
    """What of the step at 5000 particles goes into recording."""
    times = fastest(5_000, REPEATS)
    share = 100.0 * times.stages["recording"] / times.whole
    return [Figure("recording_share", share, "%", 10.0, "lower", f"5000 particles: {_told(times)}")]


def cues_figures() -> list[Figure]:
    """Milliseconds a frame of several cues: appearance, edges and silhouette, recorded."""
    times = fastest(2_000, REPEATS, *several_cues())
    return [Figure("several_cues_ms", times.whole, "ms a frame", 40.0, "lower", f"2000 particles: {_told(times)}")]


def several_cues() -> tuple[str, ...]:
    """What makes the step one of several cues, of a recorded walk or, without recordings, a generated one."""
    motions = () if os.environ.get("WORKBENCH_DATA") else ("dataset.motion=builtin", "learn.motions=builtin")
    return ("experiment=walk_best", *motions)


def fastest(n_particles: int, repeats: int, *overrides: str) -> Times:
    """The fastest of some runs of the default experiment, or that of `overrides`, 640×480 px, on all cores."""
    prepare_hydra()
    with initialize_config_module("workbench.conf", version_base="1.3"):
        given = [f"dataset.n_frames={N_FRAMES}", f"inference.n_particles={n_particles}", *overrides]
        config = compose("config", overrides=given)
    numba.set_num_threads(numba.config.NUMBA_NUM_THREADS)
    with warnings.catch_warnings(), threadpool_limits(limits=1, user_api="blas"), tempfile.TemporaryDirectory() as to:
        warnings.simplefilter("ignore")
        parts = assemble(config)
        runs = [_once(parts, config, Path(to)) for _ in trange(repeats + 1, disable=None, leave=False)]
    return min(runs[1:], key=lambda times: times.whole)


def _once(parts: Parts, config: DictConfig, folder: Path) -> Times:
    summary = Summary("step", 0, folder / "run.rrd")
    with recorder_of(config, parts, summary) as recorder:
        began = perf_counter()
        record(parts, recorder, int(config.seed), summary, quiet=True)
        whole = perf_counter() - began
    summary.recording.unlink()
    return Times(1e3 * whole / N_FRAMES, {stage: 1e3 * s / N_FRAMES for stage, s in summary.timing.items()})


def _told(times: Times) -> str:
    rest = times.whole - sum(times.stages.values())
    stages = {**times.stages, "the rest": rest}
    return f"{times.whole:.1f} ms a frame, " + ", ".join(f"{stage} {ms:.1f}" for stage, ms in stages.items())
