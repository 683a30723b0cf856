"""Time of the whole step: tracking, errors and recording, as `workbench` runs the default experiment or walk_multi_cue.

    python -m analysis.benchmarks.tracking N_FRAMES FOLDER

tracks that many frames of the default experiment with few particles and leaves run.rrd in the folder, for its memory.
What is done once (imports, rendering the scene, compiling, writing the file's end) is left out of times. The fastest of
the repeats counts; it is by the clock, and so wants a quiet machine.
"""

import os
import sys
import tempfile
import warnings
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from time import perf_counter

import numba
from hydra import compose, initialize_config_module
from omegaconf import DictConfig
from tqdm import trange

from analysis.benchmarks.figure import Figure
from workbench.core.dataset import Dataset
from workbench.core.frame import Frame
from workbench.core.frame_cache import FrameCache
from workbench.evaluation.verdict.run_measurements import MeasurementCollector
from workbench.experiment.config.schema import prepare_hydra
from workbench.experiment.run import record, recorder_of
from workbench.experiment.summary import Summary
from workbench.experiment.tracking import Components, assemble
from workbench.utils.parallel import single_blas_thread

N_FRAMES, REPEATS, FEW = 50, 10, 64


@dataclass(frozen=True)
class Times:
    """Milliseconds a frame: of the whole loop, and of its stages."""

    whole: float
    stages: dict[str, float]

    def __str__(self) -> str:
        stages = {**self.stages, "the rest": self.whole - sum(self.stages.values())}
        return f"{self.whole:.1f} ms a frame, " + ", ".join(f"{stage} {ms:.1f}" for stage, ms in stages.items())


class ToAndFro:
    """A dataset of n_frames frames: those of another, forwards and backwards again and again, so that the images take
    the same memory however long the run is."""

    def __init__(self, dataset: Dataset, n_frames: int) -> None:
        self.info = replace(dataset.info, n_frames=n_frames)
        self._dataset = dataset

    def frames(self) -> Iterator[Frame]:
        """Yield the frames, counted from 0 and with times of their own."""
        frames = list(self._dataset.frames())
        way = [*frames, *frames[-2:0:-1]]
        for index in range(self.info.n_frames):
            yield replace(way[index % len(way)], index=index, time_s=index / self.info.rate_hz)


def speed_figures() -> list[Figure]:
    """Measure frames a second of 10⁴ particles, recorded."""
    times = fastest(10_000, REPEATS)
    return [Figure("step_fps", 1e3 / times.whole, "frames/s", 35.0, "higher", f"10000 particles: {times}")]


def recording_figures() -> list[Figure]:
    """Measure the recording of a step of 5000 particles, and its share of the step."""
    times = fastest(5_000, REPEATS)
    recording_ms, what = times.stages["recording"], f"5000 particles: {times}"
    return [
        Figure("recording_ms", recording_ms, "ms a frame", 3.0, "lower", what),
        Figure("recording_share", 100.0 * recording_ms / times.whole, "%", 20.0, "lower", what),
    ]


def cues_figures() -> list[Figure]:
    """Measure milliseconds a frame of several cues: appearance, edges and silhouette, recorded."""
    times = fastest(2_000, REPEATS, *several_cues())
    return [Figure("several_cues_ms", times.whole, "ms a frame", 40.0, "lower", f"2000 particles: {times}")]


def several_cues() -> tuple[str, ...]:
    """Return the overrides for a step of several cues, of a recorded walk or, without recordings, a generated one."""
    motions = () if os.environ.get("WORKBENCH_DATA") else ("dataset.motion=builtin", "training.motions=builtin")
    return ("experiment=walk_multi_cue", *motions)


def fastest(n_particles: int, repeats: int, *overrides: str) -> Times:
    """Return the fastest of some runs of walk_straight, or of `overrides`, 640×480 px, on all cores."""
    config, parts = _assembled(n_particles, *overrides)
    with tempfile.TemporaryDirectory() as to:
        runs = [_once(parts, config, Path(to)) for _ in trange(repeats + 1, disable=None, leave=False)]
    return min(runs[1:], key=lambda times: times.whole)


def run_ms(n_frames: int, folder: Path) -> float:
    """Track and record so many frames with few particles, as a run does to its end; return milliseconds a frame."""
    config, parts = _assembled(FEW)
    parts = replace(parts, clip=FrameCache(ToAndFro(parts.clip.dataset, n_frames)))
    return _once(parts, config, folder, keep=True).whole


def _assembled(n_particles: int, *overrides: str) -> tuple[DictConfig, Components]:
    prepare_hydra()
    with initialize_config_module("workbench.conf", version_base="1.3"):
        arguments = [f"dataset.n_frames={N_FRAMES}", f"inference.n_particles={n_particles}", *overrides]
        if not any(each.startswith("experiment=") for each in overrides):
            arguments.append("experiment=walk_straight")
        config = compose("config", overrides=arguments)
    numba.set_num_threads(numba.config.NUMBA_NUM_THREADS)
    with warnings.catch_warnings(), single_blas_thread():
        warnings.simplefilter("ignore")
        return config, assemble(config)


def _once(parts: Components, config: DictConfig, folder: Path, keep: bool = False) -> Times:
    n_frames, summary = len(parts.clip), Summary("step", 0, folder / "run.rrd")
    collector = MeasurementCollector(parts.body) if keep else None
    with (
        warnings.catch_warnings(),
        single_blas_thread(),
        recorder_of(config, parts, summary) as recorder,
    ):
        warnings.simplefilter("ignore")
        started = perf_counter()
        record(parts, recorder, int(config.seed), summary, quiet=True, collector=collector)
        whole = perf_counter() - started
        if collector is not None:
            collector.measurements()
            recorder.set_result(summary.metrics)
    if not keep:
        summary.recording.unlink()
    return Times(1e3 * whole / n_frames, {stage: 1e3 * s / n_frames for stage, s in summary.timing.items()})


if __name__ == "__main__":
    print(f"{run_ms(int(sys.argv[1]), Path(sys.argv[2])):.2f} ms a frame")
