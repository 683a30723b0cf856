"""Random signals at random times: the summary, the readable part and the status agree, and no process is left."""

import json
import os
import signal
import subprocess
import sys
import time

import numpy as np
import psutil
import pytest

from workbench.recording.read.reader import read
from workbench.utils.errors import InputError

RUN = (
    "experiment=walk_straight", "prior=smooth", "dataset.n_frames=300", "inference.n_particles=500", "n_threads=1",
    "dataset.width=160", "dataset.height=120", "dataset.person_px=80", "dataset.focal_px=175",
)  # fmt: skip
SIGNALS = (signal.SIGKILL, signal.SIGTERM, signal.SIGINT)
ORPHANS_S = 5.0
"""Longest life of the workers of a killed sweep."""
SPAN_S = float(os.environ.get("WORKBENCH_TEST_SIGNAL_SPAN_S", "8"))
"""Range of the times of signals after the start."""


def started(folder, cache, *overrides):
    environment = {**os.environ, "WORKBENCH_CACHE": str(cache), "NUMBA_NUM_THREADS": "1"}
    environment.pop("WORKBENCH_DATA", None)
    output = (folder / "output.txt").open("w")
    command = [sys.executable, "-m", "workbench", "run", *RUN, *overrides]
    return subprocess.Popen(command, cwd=folder, env=environment, stdout=output, stderr=output, start_new_session=True)


def disagreements(folder):
    """Return what disagrees in the folder of a run that a signal may have ended."""
    recording, part, summary = (folder / name for name in ("run.rrd", "run.rrd.part", "summary.json"))
    if not summary.is_file():
        return ["a recording without a summary"] if recording.is_file() or part.is_file() else []
    content, problems = json.loads(summary.read_text()), []
    if recording.is_file() != (content["status"] == "complete"):
        problems.append(f"status {content['status']} with run.rrd: {recording.is_file()}")
    n_frames = int(content["metrics"].get("n_frames", 0))
    file = recording if recording.is_file() else part
    try:
        n_readable = len(read(file).poses[0]) if file.is_file() else 0
    except (InputError, LookupError, ValueError) as error:
        return [*problems, f"unreadable: {error!r}"] if n_frames else problems
    if content["status"] == "running":  # killed, perhaps between the flush and the summary
        problems += [f"{n_frames} frames in the summary, {n_readable} readable"] if n_readable < n_frames else []
    elif n_readable != n_frames:
        problems.append(f"{n_frames} frames in the summary, {n_readable} readable")
    return problems


def others_of(process):
    return psutil.Process(process.pid).children(recursive=True)


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(6))
def test_the_files_of_a_run_agree_after_any_signal(tmp_path, cache, seed):
    rng = np.random.default_rng(seed)
    number = SIGNALS[seed % len(SIGNALS)]
    with started(tmp_path, cache, "hydra.run.dir=out") as process:
        time.sleep(rng.uniform(0.0, SPAN_S))
        process.send_signal(number)
        code = process.wait(60)
    output = (tmp_path / "output.txt").read_text()
    assert not disagreements(tmp_path / "out"), output
    assert "Traceback" not in output
    assert code in (0, -number, 128 + number), output


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(3))
def test_the_files_and_processes_of_a_sweep_agree_after_any_signal(tmp_path, cache, seed):
    pytest.importorskip("hydra_plugins.hydra_joblib_launcher")
    rng = np.random.default_rng(100 + seed)
    number = SIGNALS[seed % len(SIGNALS)]
    sweep = ("-m", "hydra/launcher=joblib", "hydra.launcher.n_jobs=2", "hydra.sweep.dir=out", "seed=1,2,3")
    with started(tmp_path, cache, *sweep) as process:
        time.sleep(rng.uniform(0.3 * SPAN_S, 2.0 * SPAN_S))
        others = others_of(process) if process.poll() is None else []
        process.send_signal(number)
        code = process.wait(60)
    psutil.wait_procs(others, ORPHANS_S)
    output = (tmp_path / "output.txt").read_text()
    left = [each for each in others if each.is_running() and each.status() != psutil.STATUS_ZOMBIE]
    assert not left, output
    for folder in (tmp_path / "out").glob("[0-9]"):
        assert not disagreements(folder), output
    assert "Traceback" not in output
    assert code in (0, -number, 128 + number), output
