"""Time until the first frame: with every kernel still to be compiled, and with the kernels of an earlier run.

Runs two frames of the default experiment with few particles in processes of their own, first with an empty folder for
kernels. Seconds of processor time, which other load on the machine changes little, from command to written file.
Where pandas is installed, as by the extra `bench`, pyarrow imports it, which no run needs and which is counted.
Python's byte code is kept, as it is unless PYTHONDONTWRITEBYTECODE says otherwise, which takes 0.4 s more.
"""

import os
import resource
import subprocess
import sys
import tempfile
from pathlib import Path

from analysis.benchmarks.figure import Figure

RUN = ["-m", "workbench", "dataset.n_frames=2", "inference.n_particles=64", "threads=1"]
REPEATS = 3


def figures() -> list[Figure]:
    """Seconds to compile all kernels of a run, and to start without doing so."""
    with tempfile.TemporaryDirectory() as folder:
        told = {name: value for name, value in os.environ.items() if name != "PYTHONDONTWRITEBYTECODE"}
        environment = {**told, "NUMBA_CACHE_DIR": f"{folder}/kernels", "WORKBENCH_CACHE": f"{folder}/cache"}
        _seconds([*RUN, f"hydra.run.dir={folder}/rendered", "likelihood=uniform"], environment)  # renders the scene
        _remove_kernels(Path(folder) / "kernels")
        cold = _seconds([*RUN, f"hydra.run.dir={folder}/cold"], environment)
        cached = min(_seconds([*RUN, f"hydra.run.dir={folder}/cached_{i}"], environment) for i in range(REPEATS))
    what = "processor time of two frames of walk_straight"
    return [
        Figure("start_compile_s", cold - cached, "s", 12.0, "lower", f"{what}, less what it is with kernels kept"),
        Figure("start_cached_s", cached, "s", 2.5, "lower", f"{what}, kernels kept"),
    ]


def _remove_kernels(folder: Path) -> None:
    for path in folder.rglob("*.nb?"):
        path.unlink()


def _seconds(arguments: list[str], environment: dict[str, str]) -> float:
    """Processor time of a Python process that must succeed."""
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    subprocess.run([sys.executable, *arguments], env=environment, check=True, stdout=subprocess.DEVNULL)
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    return after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime
