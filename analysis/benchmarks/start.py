"""Time until the first frame: with every kernel still to be compiled, and with the kernels of an earlier run.

Runs two frames of the default experiment with few particles in processes of their own, first with an empty folder for
kernels, from command to written file. Compiling is by the clock, as processes share it: it wants a quiet machine with
two cores. Starting is processor time, which other load on the machine changes little.
Where pandas is installed, as by the extra `bench`, pyarrow imports it, which no run needs and which is counted.
Python's byte code is kept, as it is unless PYTHONDONTWRITEBYTECODE says otherwise, which takes 0.4 s more.
"""

import os
import resource
import subprocess
import sys
import tempfile
from pathlib import Path
from time import perf_counter

import numpy as np

from analysis.benchmarks.figure import Figure

RUN = ["-m", "workbench", "run", "dataset.n_frames=2", "inference.n_particles=64", "threads=1"]
REPEATS = 3


def figures() -> list[Figure]:
    """Seconds to compile all kernels of a run, and to start without doing so."""
    with tempfile.TemporaryDirectory() as folder:
        told = {name: value for name, value in os.environ.items() if name != "PYTHONDONTWRITEBYTECODE"}
        environment = {**told, "NUMBA_CACHE_DIR": f"{folder}/kernels", "WORKBENCH_CACHE": f"{folder}/cache"}
        _seconds([*RUN, f"hydra.run.dir={folder}/rendered", "likelihood=uniform"], environment)  # renders the scene
        cold = [_without_kernels(folder, f"cold_{i}", environment) for i in range(REPEATS)]
        kept = [_seconds([*RUN, f"hydra.run.dir={folder}/kept_{i}"], environment) for i in range(REPEATS)]
    started = np.min(kept, axis=0)
    clock, processor = np.min(cold, axis=0) - started
    what = "two frames of walk_straight"
    less = f"by the clock, {what}, less what it is with kernels kept; {processor:.1f} s of processor time"
    return [
        Figure("start_compile_s", float(clock), "s", 8.0, "lower", less),
        Figure("start_cached_s", float(started[1]), "s", 2.5, "lower", f"processor time of {what}, kernels kept"),
    ]


def _without_kernels(folder: str, run: str, environment: dict[str, str]) -> tuple[float, float]:
    for path in (Path(folder) / "kernels").rglob("*.nb?"):
        path.unlink()
    return _seconds([*RUN, f"hydra.run.dir={folder}/{run}"], environment)


def _seconds(arguments: list[str], environment: dict[str, str]) -> tuple[float, float]:
    """Seconds that a Python process takes, which must succeed: by the clock, and of processor time, with those that it
    starts."""
    before, began = resource.getrusage(resource.RUSAGE_CHILDREN), perf_counter()
    subprocess.run([sys.executable, *arguments], env=environment, check=True, stdout=subprocess.DEVNULL)
    clock, after = perf_counter() - began, resource.getrusage(resource.RUSAGE_CHILDREN)
    return clock, after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime
