"""Peak memory of the default experiment with 10⁵ particles: five frames, recording on, in a process of its own."""

import os
import subprocess
import sys
import tempfile
from collections.abc import Mapping, Sequence

from tqdm import tqdm

from analysis.benchmarks.figure import Figure

RUN = ("-m", "workbench", "run", "dataset.n_frames=5")
FEW, MANY = 64, 100_000

# A process counts as its own peak what its parent held when it was started. So a small one is put in between.
_STARTER = """
import resource, subprocess, sys
subprocess.run(sys.argv[1:], check=True, stdout=subprocess.DEVNULL)
print(resource.getrusage(resource.RUSAGE_CHILDREN).ru_maxrss)
"""
_UNIT_BYTES = 1 if sys.platform == "darwin" else 1024


def figures() -> list[Figure]:
    """Gigabytes at the most, beside what a run takes with hardly a particle."""
    few, many = peaks_gb((FEW, MANY))
    what = f"walk_straight, {MANY} particles; with {FEW} it is {few:.2f} GB"
    return [Figure("memory_1e5_gb", many, "GB", 1.5, "lower", what)]


def peaks_gb(numbers: Sequence[int]) -> list[float]:
    """Peak resident memory, 10⁹ bytes, of the default experiment with these numbers of particles."""
    with tempfile.TemporaryDirectory() as folder:
        environment = {**os.environ, "NUMBA_CACHE_DIR": f"{folder}/kernels", "WORKBENCH_CACHE": f"{folder}/cache"}

        def peak(n: int) -> float:
            return peak_gb([*RUN, f"inference.n_particles={n}", f"hydra.run.dir={folder}/run"], environment)

        peak(FEW)  # renders the scene and compiles, which is not to be counted
        return [peak(n) for n in tqdm(numbers, disable=None, leave=False)]


def peak_gb(arguments: Sequence[str], environment: Mapping[str, str]) -> float:
    """Peak resident memory, 10⁹ bytes, of a Python process that must succeed."""
    command = [sys.executable, "-c", _STARTER, sys.executable, *arguments]
    told = subprocess.run(command, env=environment, check=True, stdout=subprocess.PIPE, text=True).stdout
    return 1e-9 * _UNIT_BYTES * int(told)
