"""Time to find some of a thousand runs: the first time, when all are read, and later, when the index answers.

The runs are made up, with as many settings and numbers as a run has. `workbench runs` is started as a process of its
own, as a person does, imports included.
"""

import json
import resource
import subprocess
import sys
import tempfile
from pathlib import Path
from time import perf_counter

from analysis.benchmarks.figure import Figure

N_RUNS, PER_SWEEP = 1000, 100
REPEATS = 10
QUERY = ("prior=smooth", "n_particles>200", "error_abs_mm<5", "--sort", "error_abs_mm")


def figures() -> list[Figure]:
    """Seconds of a query over a thousand runs, the first and later ones."""
    with tempfile.TemporaryDirectory() as folder:
        make_runs(Path(folder))
        first = _seconds(folder)
        later = min(_seconds(folder) for _ in range(REPEATS))
    what = f"{N_RUNS} made-up runs"
    return [
        Figure("runs_first_s", first[0], "s", 10.0, "lower", f"{what}, all read: {first[1]:.2f} s of processor time"),
        Figure(
            "runs_later_s", later[0], "s", 0.5, "lower", f"{what}, by the index: {later[1]:.2f} s of processor time"
        ),
    ]


def make_runs(folder: Path, n_runs: int = N_RUNS) -> None:
    """Leave runs below the folder, in sweeps of PER_SWEEP: summaries and recordings of a few bytes."""
    for k in range(n_runs):
        job = folder / f"sweep_{k // PER_SWEEP}" / str(k % PER_SWEEP)
        job.mkdir(parents=True)
        (job / "run.rrd").write_bytes(b"RRF2")
        (job / "summary.json").write_text(json.dumps(_summary(k), indent=2))


def _summary(k: int) -> dict[str, object]:
    parts = {f"part_{i}": {f"key_{j}": 0.1 * j for j in range(12)} for i in range(12)}
    prior, n_particles = ("smooth", "walking")[k % 2], 100 * (k % 7)
    return {
        "status": "complete", "experiment": "walk_straight", "seed": k, "identity": f"{k:064d}", "host": "elsewhere",
        "started": f"202611{1 + k % 28:02d}T{k % 24:02d}0000.{k:06d}Z", "error": None,
        "metrics": {"error_abs_mm": k * 37 % 1000 / 10, **{f"number_{i}": i + k / 7 for i in range(50)}},
        "provenance": {"commit": "c" * 40, "choices": [f"prior={prior}"], "command": f"workbench run seed={k}"},
        "settings": {"seed": k, "inference": {"n_particles": n_particles}, **parts},
    }  # fmt: skip


def _seconds(folder: str) -> tuple[float, float]:
    """Wall time and processor time of a process that must find something."""
    before, began = resource.getrusage(resource.RUSAGE_CHILDREN), perf_counter()
    command = [sys.executable, "-m", "workbench", "runs", folder, *QUERY]
    done = subprocess.run(command, check=True, capture_output=True, text=True)
    wall, after = perf_counter() - began, resource.getrusage(resource.RUSAGE_CHILDREN)
    assert "sweep_" in done.stdout
    return wall, after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime
