"""Measuring time and memory side by side, and what it ran on."""

import os
import platform
import resource
import subprocess
import sys
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from importlib.metadata import version
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
from tqdm import tqdm

REPEATS = 12

# A process counts as its own peak what its parent held when it was started. So a small one is put in between.
_STARTER = """
import resource, subprocess, sys
subprocess.run(sys.argv[1:], check=True, stdout=subprocess.DEVNULL)
print(resource.getrusage(resource.RUSAGE_CHILDREN).ru_maxrss)
"""
_UNIT_BYTES = 1 if sys.platform == "darwin" else 1024


def fastest_s(
    timed: Sequence[Callable[[], object]], repeats: int = REPEATS, clock: Callable[[], float] = time.perf_counter
) -> list[float]:
    """Return the seconds of each function's fastest run, by a clock.

    They take turns, so that other load hits all alike, after one round that compiles and fills caches.
    """
    times = np.empty((repeats + 1, len(timed)))
    for repeat in tqdm(times, disable=None, leave=False):
        for column, function in enumerate(timed):
            start = clock()
            function()
            repeat[column] = clock() - start
    return [float(seconds) for seconds in times[1:].min(axis=0)]


def process_s(arguments: Sequence[str], environment: Mapping[str, str], code: int = 0) -> tuple[float, float]:
    """Return the seconds of a Python process, by the clock and of processor time, children's too.

    Raises ChildProcessError for another exit code than `code`.
    """
    before, began = resource.getrusage(resource.RUSAGE_CHILDREN), time.perf_counter()
    done = subprocess.run([sys.executable, *arguments], env=environment, capture_output=True, text=True)
    if done.returncode != code:
        raise ChildProcessError(f"{' '.join(arguments)}: exit code {done.returncode}: {done.stderr}")
    clock, after = time.perf_counter() - began, resource.getrusage(resource.RUSAGE_CHILDREN)
    return clock, after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime


def peak_gb(arguments: Sequence[str], environment: Mapping[str, str]) -> float:
    """Return the peak resident memory, 10⁹ bytes, of a Python process that must succeed."""
    command = [sys.executable, "-c", _STARTER, sys.executable, *arguments]
    peak = subprocess.run(command, env=environment, check=True, stdout=subprocess.PIPE, text=True).stdout
    return 1e-9 * _UNIT_BYTES * int(peak)


@contextmanager
def own_caches() -> Iterator[tuple[str, dict[str, str]]]:
    """Yield a temporary folder, and an environment whose kernels and scenes are cached there."""
    with TemporaryDirectory() as folder:
        yield folder, {**os.environ, "NUMBA_CACHE_DIR": f"{folder}/kernels", "WORKBENCH_CACHE": f"{folder}/cache"}


def machine() -> str:
    """Return the processor's name, the number of cores, and the versions of Python and of what computes."""
    cpuinfo = Path("/proc/cpuinfo")
    lines = cpuinfo.read_text().splitlines() if cpuinfo.exists() else []
    names = [line.split(":", 1)[1].strip() for line in lines if line.startswith("model name")]
    cores = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
    versions = ", ".join(f"{name} {version(name)}" for name in ("numpy", "numba", "scipy"))
    return f"{names[0] if names else platform.machine()}, {cores} cores; Python {platform.python_version()}, {versions}"
