"""Time of a sweep of short jobs: by two workers, against one job after another, with and without a thread a core.

Both sweeps are processes of their own, and what they need is compiled and rendered before. By the clock, in turns: it
wants a quiet machine with two cores.
"""

import os
import subprocess
import sys
import tempfile
from collections.abc import Mapping, Sequence
from pathlib import Path
from time import perf_counter

from analysis.benchmarks.figure import Figure

JOBS = ["-m", "workbench", "run", "-m", "dataset.n_frames=50", "inference.n_particles=6000"]
N_JOBS, REPEATS = 24, 2
WORKERS = ["hydra/launcher=joblib", "hydra.launcher.n_jobs=2"]


def figures() -> list[Figure]:
    """What part of the time two workers take, of that of one job after another on one thread; jobs on all cores are
    told beside it."""
    with tempfile.TemporaryDirectory() as folder:
        environment = {**os.environ, "NUMBA_CACHE_DIR": f"{folder}/kernels", "WORKBENCH_CACHE": f"{folder}/cache"}
        _seconds([*WORKERS, "seed=0,1", f"hydra.sweep.dir={folder}/first"], environment)  # compiles and renders
        seeds = f"seed=range({N_JOBS})"
        ways = {"alone": ["threads=1"], "all cores": ["threads=2"], "workers": ["threads=1", *WORKERS]}
        times: dict[str, float] = dict.fromkeys(ways, float("inf"))
        for repeat in range(REPEATS):
            for way, keys in ways.items():
                into = Path(folder) / f"{way.replace(' ', '_')}_{repeat}"
                times[way] = min(times[way], _seconds([*keys, seeds, f"hydra.sweep.dir={into}"], environment))
    ratio, beside = times["workers"] / times["alone"], times["workers"] / times["all cores"]
    what = (
        f"{N_JOBS} jobs one after another: {times['alone']:.0f} s on one thread; on two {times['all cores']:.0f} s, "
        f"of which two workers take {beside:.2f}"
    )
    return [Figure("two_workers", ratio, "× its time", 0.55, "lower", what)]


def _seconds(arguments: Sequence[str], environment: Mapping[str, str]) -> float:
    """Seconds that a sweep takes, which must succeed."""
    began = perf_counter()
    subprocess.run([sys.executable, *JOBS, *arguments], env=environment, check=True, capture_output=True)
    return perf_counter() - began
