"""Time until the first frame: with every kernel still to be compiled, and with the kernels of an earlier run.

    python -m analysis.benchmarks.start

Runs two frames of the default experiment with few particles in processes of their own, first with an empty folder for
kernels. Seconds of processor time, which other load on the machine changes little; what the imports take is subtracted.
"""

import os
import resource
import subprocess
import sys
import tempfile
from pathlib import Path

RUN = ["-m", "workbench", "dataset.n_frames=2", "inference.n_particles=64", "threads=1"]
IMPORTS = ["-c", "import workbench.cli.execute, workbench.cli.schema"]


def main() -> None:
    for name, value, unit, bar in figures():
        print(f"{name:<20}{value:>8.2f} {unit:<4}{bar}")


def figures() -> list[tuple[str, float, str, str]]:
    """Name, value, unit and bar of every figure."""
    with tempfile.TemporaryDirectory() as folder:
        environment = {**os.environ, "NUMBA_CACHE_DIR": f"{folder}/kernels", "WORKBENCH_CACHE": f"{folder}/cache"}
        _seconds([*RUN, f"hydra.run.dir={folder}/rendered", "likelihood=uniform"], environment)  # renders the scene
        _remove_kernels(Path(folder) / "kernels")
        cold = _seconds([*RUN, f"hydra.run.dir={folder}/cold"], environment)
        cached = min(_seconds([*RUN, f"hydra.run.dir={folder}/cached_{i}"], environment) for i in range(3))
        imports = min(_seconds(IMPORTS, environment) for _ in range(3))
    return [
        ("start_compile_s", cold - cached, "s", "<= 12"),
        ("start_cached_s", cached - imports, "s", "<= 1.5; the recording of two frames included"),
        ("start_imports_s", imports, "s", ""),
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


if __name__ == "__main__":
    main()
