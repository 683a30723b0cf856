"""Peak memory, and time a frame, of the default experiment over clips of any length, recorded.

    python -m analysis.benchmarks.length N_FRAMES FOLDER

tracks that many frames in this process and leaves run.rrd in the folder. The images are those of a short clip, gone
through to and fro, so that they take the same room however long the run is.
"""

import os
import sys
import tempfile
import warnings
from collections.abc import Iterator, Sequence
from dataclasses import replace
from pathlib import Path
from time import perf_counter

import numba
from hydra import compose, initialize_config_module
from threadpoolctl import threadpool_limits
from tqdm import tqdm

from analysis.benchmarks.figure import Figure
from analysis.benchmarks.memory import FEW, peak_gb
from workbench.core.dataset import Dataset
from workbench.core.frame import Frame
from workbench.core.frame_cache import Clip
from workbench.evaluation.evidence import Evidence
from workbench.experiment.config.schema import prepare_hydra
from workbench.experiment.run import record, recorder_of
from workbench.experiment.summary import Summary
from workbench.experiment.tracking import assemble

SHORT, LONG = 50, 5000
_CLIP = 50  # frames of the clip that is gone through


class ToAndFro:
    """A dataset of n_frames frames: those of another, gone through forwards and backwards again and again."""

    def __init__(self, dataset: Dataset, n_frames: int) -> None:
        self.known = replace(dataset.known, n_frames=n_frames)
        self._dataset = dataset

    def frames(self) -> Iterator[Frame]:
        """The frames, counted from 0 and timed anew."""
        kept = list(self._dataset.frames())
        way = [*kept, *kept[-2:0:-1]]
        for index in range(self.known.n_frames):
            yield replace(way[index % len(way)], index=index, time_s=index / self.known.rate_hz)


def figures() -> list[Figure]:
    """Megabytes of a long run at the most, beyond those of a short one."""
    short, long = peaks_gb((SHORT, LONG))
    what = f"walk_straight, {FEW} particles: {SHORT} frames take {short:.3f} GB, {LONG} {long:.3f} GB"
    return [Figure("memory_5000_frames_mb", max(1e3 * (long - short), 1.0), "MB", 100.0, "lower", what)]


def peaks_gb(lengths: Sequence[int]) -> list[float]:
    """Peak resident memory, 10⁹ bytes, of runs of so many frames."""
    with tempfile.TemporaryDirectory() as folder:
        environment = {**os.environ, "NUMBA_CACHE_DIR": f"{folder}/kernels", "WORKBENCH_CACHE": f"{folder}/cache"}

        def peak(n: int) -> float:
            return peak_gb(["-m", __name__, str(n), f"{folder}/run"], environment)

        peak(2)  # renders the scene and compiles, which is not to be counted
        return [peak(n) for n in tqdm(lengths, disable=None, leave=False)]


def run_ms(n_frames: int, folder: Path) -> float:
    """Track and record so many frames with hardly a particle; milliseconds a frame."""
    prepare_hydra()
    with initialize_config_module("workbench.conf", version_base="1.3"):
        given = [f"dataset.n_frames={_CLIP}", f"inference.n_particles={FEW}"]
        config = compose("config", overrides=given)
    numba.set_num_threads(numba.config.NUMBA_NUM_THREADS)
    with warnings.catch_warnings(), threadpool_limits(limits=1, user_api="blas"):
        warnings.simplefilter("ignore")
        parts = assemble(config)
        parts = replace(parts, clip=Clip(ToAndFro(parts.clip.dataset, n_frames)))
        summary, evidence = Summary("length", 0, folder / "run.rrd"), Evidence(parts.body)
        with recorder_of(config, parts, summary) as recorder:
            began = perf_counter()
            record(parts, recorder, int(config.seed), summary, quiet=True, evidence=evidence)
            passed = perf_counter() - began
            evidence.measured()
            recorder.set_result(summary.metrics)
    return 1e3 * passed / n_frames


if __name__ == "__main__":
    print(f"{run_ms(int(sys.argv[1]), Path(sys.argv[2])):.2f} ms a frame")
